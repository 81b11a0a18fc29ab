"""A terminal asked without being taken over: for reports, not for drawing."""

from __future__ import annotations

import select
from collections.abc import Mapping
from dataclasses import dataclass

from tsplat.errors import TerminalError
from tsplat.terminal.hearing import REMOTE_SECONDS, Hearing, ask

_ERASE_LINE = b"\r\x1b[K"
"""Terminals that do not know a question may print a part of it."""


@dataclass(frozen=True, slots=True)
class Interview:
    """What a terminal was asked and said, and its size in columns, rows and pixels as the kernel has it."""

    hearing: Hearing
    size: tuple[int, int, int, int]


def interview(environment: Mapping[str, str]) -> Interview:
    """Ask this terminal everything and leave it as it was; late answers are waited for.

    Raises
    ------
    TerminalError
        There is no terminal, it went away, or it takes nothing.
    """
    try:
        from tsplat.terminal.device import Device
        from tsplat.terminal.signals import Signals
        from tsplat.terminal.watcher import Watcher
    except ImportError as error:  # Windows has no termios
        raise TerminalError("no POSIX terminal") from error
    device, signals = Device(), Signals()
    watcher = Watcher(device.input)

    def send(screen: bytes) -> None:
        rest = memoryview(screen)
        while rest:
            if not select.select((), (device.output,), (), REMOTE_SECONDS)[1]:
                raise TerminalError("the terminal takes nothing")
            rest = rest[device.write(rest) :]

    def receive(timeout: float) -> bytes:
        return device.read() if select.select((device.input,), (), (), timeout)[0] else b""

    try:
        device.set_raw()
        watcher.expect(_ERASE_LINE)
        hearing = ask(environment, send, receive, REMOTE_SECONDS)
        send(_ERASE_LINE)
        return Interview(hearing, device.window_size())
    finally:
        device.restore()
        watcher.close()
        signals.close()
        device.close()
