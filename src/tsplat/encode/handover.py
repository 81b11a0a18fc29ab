"""Frames left in shared memory or in a file, from where a terminal on the same machine takes and removes them."""

from __future__ import annotations

import contextlib
import mmap
import os
import secrets
import tempfile
from collections import deque
from collections.abc import Callable
from pathlib import Path

from tsplat.encode.protocol import U8
from tsplat.errors import OptionError

_MOST_WAITING = 8
"""What the terminal has not fetched after so many more frames it never will; memory is not for ever."""

_FILE_MARK = "tty-graphics-protocol"
"""Kitty removes no file without this in its name."""

_SHARED_DIRECTORY = Path("/dev/shm")


class Handover:
    """Leaves frames for the terminal and removes those it did not take.

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
        self._waiting: deque[str] = deque()

    def leave(self, frame: U8) -> bytes:
        """Store a frame's bytes; return the name under which the terminal finds them.

        Raises
        ------
        OSError
            There is no room.
        """
        name = self._leave(frame)
        self._waiting.append(name)
        if len(self._waiting) > _MOST_WAITING:
            self._remove(self._waiting.popleft())
        return name.encode()

    def clear(self) -> None:
        """Remove every frame that the terminal did not take."""
        while self._waiting:
            self._remove(self._waiting.popleft())


def _leave_file(frame: U8) -> str:
    directory = _SHARED_DIRECTORY if os.access(_SHARED_DIRECTORY, os.W_OK) else None
    file, name = tempfile.mkstemp(prefix=f"tsplat-{_FILE_MARK}-", dir=directory)
    with os.fdopen(file, "wb") as stream:
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


def _shared_memory() -> tuple[Callable[[U8], str], Callable[[str], None]]:
    # Not `multiprocessing.shared_memory`: it starts a process that removes the memory a second time and complains.
    try:
        from _posixshmem import shm_open, shm_unlink
    except ImportError as error:
        raise OptionError(
            'kitty\'s transport "shared" needs POSIX shared memory; use "file" or "direct"'
        ) from error

    def leave(frame: U8) -> str:
        name = f"/tsplat-{secrets.token_hex(8)}"  # macOS takes no more than 30 characters
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
