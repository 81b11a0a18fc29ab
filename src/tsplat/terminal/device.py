"""The tty as a file: opening, raw mode, reading, writing, its size. POSIX only; imported when a session starts."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import struct
import termios
import tty

from tsplat.errors import TerminalError

STDIN, STDOUT = 0, 1
_GONE = (errno.EIO, errno.EPIPE, errno.ENXIO, errno.EBADF)
_PIECE = 512
"""Bytes to write at once where a write may wait: a terminal that is ready takes at least a few."""


class Device:
    """The terminal of this process.

    Raises
    ------
    TerminalError
        Standard output is not a terminal, or there is none to read keys from.
    """

    def __init__(self) -> None:
        if not os.isatty(STDOUT):
            raise TerminalError("standard output is not a terminal; run it in one, or use 'tsplat render'")
        self.input = STDIN if os.isatty(STDIN) else _open_controlling_terminal()
        self.output = _open_for_writing()
        self._before = termios.tcgetattr(self.input)

    def close(self) -> None:
        """Close what was opened; standard input and output stay open."""
        for opened, standard in ((self.input, STDIN), (self.output, STDOUT)):
            if opened != standard:
                os.close(opened)

    def set_raw(self) -> None:
        """Deliver each byte as it comes, without echo and without signals for Ctrl-C and Ctrl-Z."""
        try:
            tty.setraw(self.input, termios.TCSADRAIN)
        except termios.error as error:
            raise TerminalError(f"the terminal does not take settings: {error.args[-1]}") from error

    def restore(self) -> None:
        """Set what was set before, and drop input not read yet: the shell would take it for commands."""
        with contextlib.suppress(termios.error):  # it is gone, and so are its settings
            termios.tcsetattr(self.input, termios.TCSAFLUSH, self._before)

    def drop_output(self) -> None:
        """Drop what was written and not taken, to make room for what gives the terminal back."""
        with contextlib.suppress(termios.error):
            termios.tcflush(self.output, termios.TCOFLUSH)

    def read(self) -> bytes:
        """Return what is there, at least one byte; call it when there is something.

        Raises
        ------
        TerminalError
            The terminal went away.
        """
        try:
            received = os.read(self.input, 1 << 16)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise TerminalError(f"the terminal went away: {error.strerror}") from error
        if not received:
            raise TerminalError("the terminal went away: end of input")
        return received

    def write(self, screen: memoryview) -> int:
        """Write what the terminal takes now; return how many bytes. Call it when it is ready for some.

        Raises
        ------
        TerminalError
            The terminal went away.
        """
        try:
            return os.write(self.output, screen if self.output != STDOUT else screen[:_PIECE])
        except BlockingIOError:
            return 0
        except OSError as error:
            if error.errno not in _GONE:
                raise
            raise TerminalError(f"the terminal went away: {error.strerror}") from error

    def window_size(self) -> tuple[int, int, int, int]:
        """Return columns, rows, and width and height in pixels, each 0 where the terminal did not say."""
        try:
            reply = fcntl.ioctl(self.output, termios.TIOCGWINSZ, bytes(8))
        except OSError:
            return 0, 0, 0, 0
        rows, columns, width, height = struct.unpack("HHHH", reply)
        return columns, rows, width, height


def _open_controlling_terminal() -> int:
    try:
        return os.open("/dev/tty", os.O_RDWR | os.O_NOCTTY | os.O_CLOEXEC)
    except OSError as error:
        raise TerminalError(f"no terminal to read keys from: /dev/tty: {error.strerror}") from error


def _open_for_writing() -> int:
    """Open the terminal behind standard output once more, so that writes do not wait; else return that.

    Whether writes wait is a property of the open file. Standard output's is shared with the shell, which
    would find its own writes cut short; one opened by name is ours alone.
    """
    flags = os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC
    with contextlib.suppress(OSError):  # in a container the name may lead nowhere, after su it is forbidden
        return os.open(os.ttyname(STDOUT), flags)
    with contextlib.suppress(OSError):
        os.tcgetpgrp(STDOUT)  # fails where standard output is not the terminal /dev/tty stands for
        return os.open("/dev/tty", flags)
    return STDOUT
