"""Signals that end this process wait until the terminal was given back, by the process of `Watcher`.

Otherwise the shell would take the terminal at the same time. What a handler may do is little: after a bus error,
or in the middle of an allocation, neither Python nor most of C works any more. This one is machine code that calls
five functions of the system, all of them made for it (POSIX.1-2017, 2.4.3). One written in Python would not even
be called: a fault is repeated until something is done about it.
"""

from __future__ import annotations

import ctypes
import select
import signal
import socket
import sys
from functools import cache
from typing import Any

SECONDS = 2.0
"""How long a signal waits at most."""

_NAMES: tuple[str, ...] = ("ILL", "TRAP", "ABRT", "BUS", "FPE", "SEGV", "SYS", "EMT", "STKFLT", "QUIT", "USR1")
_NAMES += ("USR2", "ALRM", "VTALRM", "PROF", "XCPU", "XFSZ", "PIPE", "PWR")
_NAMES += ("IO",) * (sys.platform == "linux")  # elsewhere it is ignored
"""Signals whose default is to end a process, but for those that Python code handles, see `Signals`."""

_HANDLER = """
define void @handle(i32 %number) {{
  %end = load i32, ptr inttoptr (i64 {watched} to ptr)
  %ended = call i32 inttoptr (i64 {shutdown} to ptr) (i32 %end, i32 {ways})
  %given = call i32 inttoptr (i64 {poll} to ptr) (ptr inttoptr (i64 {watched} to ptr), i64 1, i32 {milliseconds})
  %keys = load i32, ptr inttoptr (i64 {keys} to ptr)
  %dropped = call i32 inttoptr (i64 {tcflush} to ptr) (i32 %keys, i32 {input})
  %place = getelementptr ptr, ptr inttoptr (i64 {before} to ptr), i32 %number
  %before = load ptr, ptr %place
  %ours = call ptr inttoptr (i64 {signal} to ptr) (i32 %number, ptr %before)
  %raised = call i32 inttoptr (i64 {raise_} to ptr) (i32 %number)
  ret void
}}
"""
"""Let the watcher act, wait until it has ended, drop keys that a shell would read, then end as before."""


class _Poll(ctypes.Structure):
    """``struct pollfd``: the socket, and what to wait for."""

    _fields_ = (("fd", ctypes.c_int), ("events", ctypes.c_short), ("revents", ctypes.c_short))


_watched, _keys = _Poll(-1, select.POLLIN, 0), ctypes.c_int(-1)
_before = (ctypes.c_void_p * (signal.NSIG + 1))()
"""What the handler works with, by its address."""


class FatalSignals:
    """Catches signals that would end this process.

    Parameters
    ----------
    watched : int
        File descriptor of the socket at whose end the watcher acts, and ends its own side.
    keys : int
        File descriptor of the terminal that keys come from.
    """

    def __init__(self, watched: int, keys: int) -> None:
        self._caught: list[int] = []
        _watched.fd, _keys.value = watched, keys
        handler, set_handler = _handler(), _function("signal")
        for number in _numbers():
            # What somebody handles or ignores stays that way.
            if signal.getsignal(number) in (signal.SIG_DFL, None):
                _before[number] = set_handler(number, handler)
                self._caught.append(number)

    def close(self) -> None:
        """Let these signals do what they did before."""
        set_handler = _function("signal")
        while self._caught:
            number = self._caught.pop()
            set_handler(number, _before[number])
        _watched.fd = -1


def _numbers() -> list[int]:
    named = [getattr(signal, f"SIG{name}", 0) for name in _NAMES]
    first, last = getattr(signal, "SIGRTMIN", 1), getattr(signal, "SIGRTMAX", 0)
    return [number for number in (*named, *range(first, last + 1)) if number in signal.valid_signals()]


@cache
def _function(name: str) -> Any:
    function = getattr(ctypes.CDLL(None), name)
    if name == "signal":
        function.argtypes, function.restype = (ctypes.c_int, ctypes.c_void_p), ctypes.c_void_p
    return function


@cache
def _handler() -> int:
    """Return the address of the handler."""
    import termios

    from tsplat._machine_code import assembled

    names = {name: _address(name.rstrip("_")) for name in ("shutdown", "poll", "tcflush", "signal", "raise_")}
    places = {"watched": _watched, "keys": _keys, "before": _before}
    text = _HANDLER.format(
        **names,
        **{name: ctypes.addressof(place) for name, place in places.items()},
        ways=socket.SHUT_WR,
        milliseconds=round(1e3 * SECONDS),
        input=termios.TCIFLUSH,
    )
    return assembled(text, "handle")


def _address(name: str) -> int:
    return ctypes.cast(_function(name), ctypes.c_void_p).value or 0
