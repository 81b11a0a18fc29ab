"""Files that are whole or not there at all."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from tsplat.errors import SaveError, TsplatError


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
                yield file
            beside.replace(path)
        except BaseException:
            beside.unlink(missing_ok=True)
            raise
    except TsplatError:
        raise  # what went wrong was not the writing
    except OSError as error:
        raise SaveError(f"{path}: cannot be written: {error.strerror or error}; choose another folder") from error
