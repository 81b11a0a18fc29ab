"""The one place that touches the tty: raw mode, the alternate screen, input and output, all given back."""

from __future__ import annotations

import os
from collections.abc import Mapping
from types import TracebackType

from tsplat.terminal.keys import Event, TerminalSize
from tsplat.terminal.probe import Profile


class Session:
    """A terminal taken over for full-screen drawing; a context manager that gives it back as it was.

    Entering opens the terminal, puts it into raw mode without signals (Ctrl-C arrives as the key
    "ctrl+c", Ctrl-Z as "ctrl+z"), asks what it can do unless a profile was given, and turns on the
    alternate screen, the mouse and, where known, the kitty keyboard; the cursor is hidden and autowrap is off.
    Leaving, also by an exception, SIGTERM or SIGHUP, undoes all that in reverse order.

    Parameters
    ----------
    profile : Profile, optional
        What the terminal can do; without it, it is asked.
    environment : mapping of str to str
        Environment variables.

    Raises
    ------
    TerminalError
        On entering: there is no terminal.
    """

    profile: Profile
    """What the terminal can do; known once entered."""

    def __init__(self, profile: Profile | None = None, environment: Mapping[str, str] = os.environ) -> None:
        raise NotImplementedError

    def __enter__(self) -> Session:
        raise NotImplementedError

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        raise NotImplementedError

    def size(self) -> TerminalSize:
        """Return the size now."""
        raise NotImplementedError

    def events(self, timeout: float) -> list[Event]:
        """Return what happened, as soon as something did; an empty list after ``timeout`` seconds.

        Raises
        ------
        TerminalError
            The terminal went away.
        """
        raise NotImplementedError

    def write(self, screen: bytes) -> None:
        """Write all bytes; returns when the terminal has taken them.

        Raises
        ------
        TerminalError
            The terminal went away.
        """
        raise NotImplementedError

    def synchronized(self, screen: bytes) -> bytes:
        """Return bytes that show ``screen`` in one step where the terminal can, else ``screen`` itself.

        A frame is ``session.write(encoded.upload + session.synchronized(encoded.draw + hud))``.
        """
        raise NotImplementedError

    def suspend(self) -> None:
        """Give the terminal back, stop the process as Ctrl-Z does, and take the terminal again when it
        is resumed; the next `events` then begins with a `Resize`."""
        raise NotImplementedError
