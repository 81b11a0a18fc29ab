"""Front door: `Session`, the only code that touches the tty, its events, and what the terminal can do."""

from __future__ import annotations

from tsplat.terminal.keys import Answered, Event, Focus, Key, Mouse, Resize, TerminalSize
from tsplat.terminal.outputs import choose_output, outputs
from tsplat.terminal.probe import Profile, detect
from tsplat.terminal.session import Session

__all__ = [
    "Answered",
    "Event",
    "Focus",
    "Key",
    "Mouse",
    "Profile",
    "Resize",
    "Session",
    "TerminalSize",
    "choose_output",
    "detect",
    "outputs",
]
