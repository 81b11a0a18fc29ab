"""A process that gives the terminal back when this one no longer can: whatever ends it, SIGKILL too.

It is a few lines for the shell, which every POSIX system has: it starts in a millisecond, and there is hardly
anything in it that could go wrong along with this process.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import socket

from tsplat.terminal.device import STDOUT
from tsplat.terminal.fatal_signals import FatalSignals

SHELL = "/bin/sh"
SECONDS = 1.0
"""How long it may take to be ready, and to end: milliseconds. Then we do without it."""

_SCRIPT = """
trap '' HUP INT QUIT TERM TSTP TTIN TTOU PIPE ALRM USR1 USR2
before=$(stty -g <&2 2>/dev/null)
echo >&0
screen=
while IFS= read -r line; do
    screen=$line
    taken=$(stty -g <&2 2>/dev/null)
done
[ -n "$screen" ] || exit 0
printf %s "$screen"
# Unless the shell was quicker, and the terminal is as it wants it.
[ "$(stty -g <&2 2>/dev/null)" = "$taken" ] && stty "$before" <&2 2>/dev/null
"""
"""Standard input is a socket that ends with this process, output the terminal, error the one of the keys."""

_HIGH = 10
"""No file descriptor below this stands in the way of the three that the script has."""


class Watcher:
    """The process; it has to be started while the terminal's settings are those to come back to.

    Until it is closed, signals that end this process wait for it; see `FatalSignals`.

    Parameters
    ----------
    settings : int
        File descriptor of the terminal whose settings are changed, and keys are read.
    """

    def __init__(self, settings: int) -> None:
        self._socket: socket.socket | None = None
        """Our side of what connects them, which tells each when the other ends; None where there is no process."""
        with contextlib.suppress(OSError, NotImplementedError):  # a system without a shell, or without room for it
            with contextlib.ExitStack() as opened:
                ours, theirs = map(opened.enter_context, socket.socketpair())
                self._pid = _start(theirs.fileno(), settings)
                theirs.close()
                ours.settimeout(SECONDS)
                self._socket, self._signals = ours, FatalSignals(ours.fileno(), settings)
                opened.pop_all()
            if not _next(ours):
                self.close()

    def expect(self, screen: bytes) -> None:
        """Say what to write, and then to set the terminal back, should this process end; b"" for nothing at all.

        The settings that the terminal has now are taken for ours.
        """
        if self._socket:
            with contextlib.suppress(OSError):  # somebody ended it
                self._socket.sendall(screen + b"\n")

    def close(self) -> None:
        """End it: the terminal was given back."""
        if not self._socket:
            return
        self.expect(b"")
        self._signals.close()
        with self._socket, contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_WR)
            ended = _next(self._socket) == b""
            os.waitpid(self._pid, 0 if ended else os.WNOHANG)
        self._socket = None


def _start(theirs: int, settings: int) -> int:
    high = [fcntl.fcntl(each, fcntl.F_DUPFD_CLOEXEC, _HIGH) for each in (theirs, STDOUT, settings)]
    try:
        return os.posix_spawn(
            SHELL,
            ["sh", "-c", _SCRIPT],
            {"PATH": _absolute_path(), "LC_ALL": "C"},
            file_actions=[(os.POSIX_SPAWN_DUP2, each, number) for number, each in enumerate(high)],
            setsid=True,  # what the terminal or a shell does to our group is not meant for it
        )
    finally:
        for each in high:
            os.close(each)


def _next(ours: socket.socket) -> bytes | None:
    """Return what the process says, b"" when it has ended, None where it takes too long."""
    try:
        return ours.recv(1)
    except TimeoutError:
        return None


def _absolute_path() -> str:
    """Return where to look for programs, without any place that depends on the current folder."""
    return os.pathsep.join(place for place in os.get_exec_path() if os.path.isabs(place))
