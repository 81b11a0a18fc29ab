"""Frames left in shared memory or in a file, from where a terminal on the same machine takes and removes them."""

from __future__ import annotations

import contextlib
import mmap
import os
from collections import deque
from collections.abc import Callable
from itertools import count
from pathlib import Path
from tempfile import gettempdir

from tsplat._leftovers import Owner
from tsplat.encode.protocol import U8
from tsplat.errors import OptionError

_MOST_WAITING = 8
"""What the terminal has not fetched after so many more frames it never will; memory is not for ever."""

_FILE_MARK = "tty-graphics-protocol"
"""Kitty removes no file without this in its name."""

_SHARED_DIRECTORY = Path("/dev/shm")


_numbers = count()
"""Of frames, in this process."""


class Handover:
    """Leaves frames for the terminal and removes those it did not take, and those that ended processes left.

    Parameters
    ----------
    transport : {"shared", "file"}
        POSIX shared memory or temporary files.

    Raises
    ------
    OptionError
        This system has no POSIX shared memory.
    """

    def __init__(self, transport: str) -> None:
        self.medium = b"s" if transport == "shared" else b"t"
        """What the protocol calls the transport."""
        self._leave, self._remove = _shared_memory() if transport == "shared" else (_leave_file, _remove_file)
        self._folder = _SHARED_DIRECTORY if transport == "shared" else _folder_of_files()
        self._owner: Owner | None = None
        self._waiting: deque[str] = deque()

    def leave(self, frame: U8) -> bytes:
        """Store a frame's bytes; return the name under which the terminal finds them.

        Raises
        ------
        OSError
            There is no room.
        """
        if self._owner is None:
            self._owner = Owner(self._folder)
        name = self._leave(frame, f"{self._owner.name}-{next(_numbers)}")
        self._waiting.append(name)
        if len(self._waiting) > _MOST_WAITING:
            self._remove(self._waiting.popleft())
        return name.encode()

    def clear(self) -> None:
        """Remove every frame that the terminal did not take."""
        while self._waiting:
            self._remove(self._waiting.popleft())
        if self._owner:
            self._owner.close()
            self._owner = None


def _folder_of_files() -> Path:
    return _SHARED_DIRECTORY if os.access(_SHARED_DIRECTORY, os.W_OK) else Path(gettempdir())


def _leave_file(frame: U8, called: str) -> str:
    name = str(_folder_of_files() / f"{called}-{_FILE_MARK}")
    with open(os.open(name, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as stream:
        try:
            stream.write(frame.data)
            stream.flush()
        except OSError:
            _remove_file(name)
            raise
    return name


def _remove_file(name: str) -> None:
    with contextlib.suppress(OSError):
        Path(name).unlink()


def _shared_memory() -> tuple[Callable[[U8, str], str], Callable[[str], None]]:
    # Not `multiprocessing.shared_memory`: it starts a process that removes the memory a second time and complains.
    try:
        from _posixshmem import shm_open, shm_unlink
    except ImportError as error:
        raise OptionError(
            'kitty\'s transport "shared" needs POSIX shared memory; use "file" or "direct"'
        ) from error

    def leave(frame: U8, called: str) -> str:
        name = f"/{called}"  # macOS takes no more than 30 characters
        file = shm_open(name, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o600)
        try:
            os.ftruncate(file, frame.nbytes)
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file, 0, frame.nbytes)  # writing where there is no room would end the process
            with mmap.mmap(file, frame.nbytes) as memory:
                memory[:] = frame.data.cast("B")
        except OSError:
            remove(name)
            raise
        finally:
            os.close(file)
        return name

    def remove(name: str) -> None:
        with contextlib.suppress(OSError):
            shm_unlink(name)

    return leave, remove
