"""Folders that do not outlast the process, nor the next one that makes one."""

from __future__ import annotations

import os
import re
import secrets
import shutil
import weakref
from pathlib import Path
from tempfile import gettempdir

from tsplat._leftovers import clear, hold

_NAME = re.compile(r"tsplat-[0-9a-f]{16}\.tmp")
"""A name that nobody else gives, as what is left under it is removed."""


class TemporaryFolder:
    """A folder for nobody else, which goes with this object; those that ended processes left go now.

    Attributes
    ----------
    name : str
        Where it is.

    Raises
    ------
    OSError
        There is no room, or no folder for temporary files.
    """

    def __init__(self) -> None:
        clear(Path(gettempdir()), _NAME)
        held, descriptor = False, None
        while not held:
            folder = Path(gettempdir()) / f"tsplat-{secrets.token_hex(8)}.tmp"
            folder.mkdir(0o700)
            if os.name == "nt":
                break
            descriptor = os.open(folder, os.O_RDONLY)
            held = hold(descriptor, folder)
            if not held:
                os.close(descriptor)
        self.name = str(folder)
        # Whoever quits does not wait for a file that is just coming.
        self._end = weakref.finalize(self, _remove_folder, self.name, descriptor, os.getpid())

    def __enter__(self) -> str:
        return self.name

    def __exit__(self, *_: object) -> None:
        self._end()


def _remove_folder(name: str, descriptor: int | None, process: int) -> None:
    if os.getpid() == process:  # not a child that was forked meanwhile
        shutil.rmtree(name, ignore_errors=True)
    if descriptor is not None:
        os.close(descriptor)
