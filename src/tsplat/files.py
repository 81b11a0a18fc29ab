"""Files that are whole or not there at all."""

from __future__ import annotations

import atexit
import errno
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from tsplat.errors import SaveError, TsplatError

_unfinished: set[Path] = set()
"""What a daemon thread may still be writing when the process ends."""


@atexit.register
def _remove_unfinished() -> None:
    for beside in tuple(_unfinished):
        with suppress(OSError):
            beside.unlink(missing_ok=True)


@contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """Open a file beside ``path`` that takes its place, in one step, when all went well.

    Raises
    ------
    SaveError
        It cannot be written, which is tried before anything else is done; nothing is left behind.
    """
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, "it is a folder")
        try:
            with beside.open("xb") as file:
                _unfinished.add(beside)
                yield file
            beside.replace(path)
        except BaseException:
            beside.unlink(missing_ok=True)
            raise
        finally:
            _unfinished.discard(beside)
    except TsplatError:
        raise  # what went wrong was not the writing
    except OSError as error:
        raise SaveError(f"{path}: cannot be written: {error.strerror or error}; choose another folder") from error


@contextmanager
def tidy_end() -> Iterator[None]:
    """Let SIGTERM and SIGHUP end this process as an error does, so that no unfinished or temporary file stays."""

    def leave(number: int, _: object) -> None:
        sys.exit(128 + number)

    numbers = signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)
    heard = threading.current_thread() is threading.main_thread()
    deadly = [number for number in numbers if heard and signal.getsignal(number) is signal.SIG_DFL]
    for number in deadly:
        signal.signal(number, leave)
    try:
        yield
    finally:
        for number in deadly:
            signal.signal(number, signal.SIG_DFL)
