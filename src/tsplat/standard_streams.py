"""Standard output and error that may fail: closed, on a full disk, or read by nobody any more.

All that commands print goes through here. Output that is lost is an error of one line; an error that nobody can be
told is lost in silence, as the exit status still tells it.
"""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from tsplat.errors import SaveError


@contextmanager
def standard_streams() -> Iterator[None]:
    """Let nothing that is printed meanwhile end in a traceback.

    Raises
    ------
    SaveError
        Standard output fails.
    BrokenPipeError
        Its reader has gone, which is no reason to say anything.
    """
    before = sys.stdout, sys.stderr
    for stream in before:
        if hasattr(stream, "reconfigure"):  # what an encoding lacks is escaped
            stream.reconfigure(errors="backslashreplace")
    sys.stdout, sys.stderr = _Output(before[0]), _Error(before[1])
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


def open_closed_streams() -> None:
    """Open what was closed before the process began, so that no file gets the number of a standard stream."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest number that is free


class _Output:
    """A stream, or none, with one place for what goes wrong in writing to it."""

    def __init__(self, stream: Any, errors: list[OSError] | None = None) -> None:
        self._stream = stream
        self._errors = [] if errors is None else errors  # what failed once stays so, whoever was told of it

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    @property
    def encoding(self) -> str:
        """The encoding of what is written."""
        return getattr(self._stream, "encoding", None) or "utf-8"

    @property
    def buffer(self) -> _Output:
        """The same for bytes."""
        return type(self)(None if self._stream is None else self._stream.buffer, self._errors)

    def isatty(self) -> bool:
        """Tell whether a terminal shows it."""
        return self._stream is not None and bool(self._stream.isatty())

    def write(self, text: Any) -> int:
        """Write text, or bytes."""
        return int(self._try("write", text) or 0)

    def writelines(self, lines: Any) -> None:
        """Write several."""
        self._try("writelines", lines)

    def flush(self) -> None:
        """Have it written; a stream that is closed loses nothing of nothing."""
        if self._stream is not None or self._errors:
            self._try("flush")

    def _try(self, method: str, *args: Any) -> Any:
        try:
            if self._stream is None:
                raise OSError(errno.EBADF, "it is closed")
            if not self._errors:
                return getattr(self._stream, method)(*args)
        except OSError as error:
            self._errors.append(error)
            self._silence()
        return self._failed(self._errors[0])

    def _failed(self, error: OSError) -> None:
        if isinstance(error, BrokenPipeError):
            raise error
        raise SaveError(f"standard output: cannot be written: {error.strerror or error}") from error

    def _silence(self) -> None:
        """Let what is still in the buffer go nowhere: Python would try again when it ends."""
        with suppress(OSError, ValueError, AttributeError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self._stream.fileno())
            os.close(nowhere)


class _Error(_Output):
    """Standard error, where nothing is said of what cannot be said."""

    def _failed(self, error: OSError) -> None:
        pass
