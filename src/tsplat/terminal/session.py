"""A terminal taken over: raw mode, the alternate screen, input and output, all given back at the end."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import time
from collections.abc import Mapping
from types import TracebackType
from typing import TYPE_CHECKING

from tsplat.errors import TerminalError
from tsplat.terminal.hearing import LOCAL_SECONDS, REMOTE_SECONDS, Hearing, ask
from tsplat.terminal.keys import Answered, Event, Resize, TerminalSize
from tsplat.terminal.limits import MOST_WAITING
from tsplat.terminal.modes import SCREEN, UNFINISHED, reports_pixels, turn_off, turn_on
from tsplat.terminal.parser import Parser, PixelReport, SizeReport
from tsplat.terminal.probe import SIZE_REPORTS, Profile, detect, size_questions
from tsplat.terminal.questions import is_remote
from tsplat.terminal.sizes import Sizes

if TYPE_CHECKING:
    from tsplat.terminal.device import Device
    from tsplat.terminal.signals import Signals
    from tsplat.terminal.watcher import Watcher

ESCAPE_DELAY = 0.05
"""Seconds after which an escape with nothing behind it was the key; SSH delivers sequences in one piece."""

STALL_SECONDS = 60.0
"""Seconds after which a terminal that takes nothing is given up: a line that hangs may come back before."""

FAREWELL_SECONDS = 1.0
"""Seconds to wait for a terminal to take what gives it back; one that takes nothing holds nobody up."""

_LATE_BYTES = 1 << 14
"""Bytes of input among which late answers are looked for; then there are none to come."""


class Session:
    """A terminal taken over for full-screen drawing; a context manager that gives it back as it was.

    Entering opens the terminal, puts it into raw mode without signals (Ctrl-C arrives as the key
    "ctrl+c", Ctrl-Z as "ctrl+z"), switches to the alternate screen, asks what the terminal can do unless
    a profile was given, and turns on the mouse and, where there is one, the kitty keyboard; the cursor is
    hidden and autowrap is off. Leaving, also by an exception, SIGTERM or SIGHUP, undoes all that in
    reverse order; where this process is ended in any other way, `Watcher` does.

    Parameters
    ----------
    profile : Profile, optional
        What the terminal can do; without it, it is asked.
    environment : mapping of str to str
        Environment variables.

    Attributes
    ----------
    profile : Profile
        What the terminal can do; known once entered.
    question : bytes
        Written behind a frame, it comes back as an `Answered` when the terminal has got so far. Answers
        to questions from before a `Resize` may never come: the terminal was given back in between.

    Raises
    ------
    TerminalError
        On entering: there is no terminal.
    """

    question = b"\x1b[5n"

    def __init__(self, profile: Profile | None = None, environment: Mapping[str, str] = os.environ) -> None:
        self.profile = profile or Profile()
        self._known, self._environment = profile is not None, environment
        self._parser, self._writing = Parser(), False
        self._waiting: list[Event] = []
        self._signalled: set[int] = set()
        self._unanswered = 0
        self._sizes_asked = dict.fromkeys(SIZE_REPORTS, 0)
        self._hearing: Hearing | None = None
        self._device: Device
        self._sizes: Sizes
        self._signals: Signals
        self._watcher: Watcher

    def __enter__(self) -> Session:
        try:
            from tsplat.terminal.device import Device
            from tsplat.terminal.signals import Signals
            from tsplat.terminal.watcher import Watcher
        except ImportError as error:  # Windows has no termios
            raise TerminalError("the viewer needs a POSIX terminal; use WSL, or 'tsplat render'") from error
        self._device, self._signals = Device(), Signals()
        self._watcher = Watcher(self._device.input)
        try:
            self._take()
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._close()

    @property
    def is_remote(self) -> bool:
        """Whether the terminal is on another machine, over SSH."""
        return is_remote(self._environment)

    def size(self) -> TerminalSize:
        """Return the size now; 80 x 24 where the terminal does not say."""
        return self._sizes.now()

    def events(self, timeout: float) -> list[Event]:
        """Return what happened, as soon as something did; an empty list after ``timeout`` seconds.

        Raises
        ------
        TerminalError
            The terminal went away.
        """
        deadline = time.monotonic() + timeout
        self._learn()
        if self._signalled:
            self._heed()
        while not self._waiting:
            ready = self._ready(max(0.0, deadline - time.monotonic()))
            if self._signals in ready:
                self._signalled |= self._signals.noted()
                self._heed()
            if self._device.input in ready:
                self._receive()
                self._learn()
            if not ready:
                break
        events, self._waiting = self._waiting, []
        return events

    def write(self, screen: bytes) -> None:
        """Write all bytes; returns when the terminal has taken them.

        Meanwhile input is read, for the next `events`, and signals are heeded: after a stop the rest of
        ``screen`` is dropped, as the `Resize` that follows asks for all of it anew.

        Raises
        ------
        TerminalError
            The terminal went away, or took nothing for `STALL_SECONDS`.
        """
        self._unanswered += screen.count(self.question)
        self._send(screen, STALL_SECONDS, self._device.input, self._signals)

    def synchronized(self, screen: bytes) -> bytes:
        """Return bytes that show ``screen`` in one step where the terminal can, else ``screen`` itself.

        A frame is ``session.write(encoded.upload + session.synchronized(encoded.draw + hud))``.
        """
        return b"\x1b[?2026h" + screen + b"\x1b[?2026l" if self.profile.synchronized else screen

    def suspend(self) -> None:
        """Give the terminal back and stop as Ctrl-Z does; take the terminal again when continued.

        The next `events` begins with a `Resize`; all that was on screen is gone.
        """
        self._give_back()
        self._signals.stop()
        self._take()
        self._waiting.insert(0, Resize(self.size()))

    def _take(self) -> None:
        self._device.set_raw()
        self._watch()
        self._send(SCREEN[0])
        if not self._known:
            # Asked on the alternate screen, where what a terminal prints by mistake harms nobody.
            self._ask()
        self._know_sizes()
        self._watch()
        self._send(turn_on(self.profile))

    def _watch(self) -> None:
        """Say what gives the terminal back, should this process end before it can."""
        self._watcher.expect(UNFINISHED + turn_off(self.profile))

    def _ask(self) -> None:
        """Learn what the terminal can do; what a person typed meanwhile is not lost."""
        hearing = ask(self._environment, self._send, self._next_input)
        self.profile, self._known = detect(self._environment, hearing.replies, hearing.tmux), True
        typed = self._parser.feed(hearing.replies)
        self._waiting += [event for event in typed if not isinstance(event, PixelReport | SizeReport)]
        self._hearing = None if hearing.answered else hearing
        self._sizes_asked = dict.fromkeys(SIZE_REPORTS, int(not hearing.answered))

    def _next_input(self, timeout: float) -> bytes:
        return self._device.read() if self._ready(timeout, self._device.input) else b""

    def _learn(self) -> None:
        """Take late answers as if they had come in time: a terminal may have been busy starting."""
        if self._hearing is None or not self._hearing.answered:
            return
        before, hearing, self._hearing = self.profile, self._hearing, None
        self.profile = detect(self._environment, hearing.replies, hearing.tmux)
        self._know_sizes()
        self._watch()
        self._send(turn_on(self.profile, before))
        self._waiting.append(Resize(self.size()))

    def _close(self) -> None:
        try:
            self._signals.ignore_fatal()  # a second SIGTERM must not stop this half way
        finally:
            try:
                self._give_back()
            finally:
                self._watcher.close()
                self._signals.close()
                self._device.close()

    def _give_back(self) -> None:
        with contextlib.suppress(TerminalError):  # it may be gone, which may be why we are here
            if self._writing and not self._ready(FAREWELL_SECONDS, writing=True):
                self._device.drop_output()
            # Until the terminal has heard that it should not, it reports that the last key came up.
            farewell = turn_off(self.profile) + self.question * self.profile.kitty_keyboard
            self._unanswered += self.profile.kitty_keyboard
            self._send(UNFINISHED * self._writing + farewell, FAREWELL_SECONDS)
            self._hear_out()
        self._device.restore()
        self._watcher.expect(b"")

    def _hear_out(self) -> None:
        """Wait for answers still on their way: the shell would take them for something typed."""
        deadline = time.monotonic() + (REMOTE_SECONDS if self.is_remote else LOCAL_SECONDS)
        while (self._unanswered or self._hearing) and (left := deadline - time.monotonic()) > 0:
            if self._ready(left, self._device.input):
                self._receive()
            if self._hearing and self._hearing.answered:
                self._hearing = None
        self._unanswered, self._hearing = 0, None

    def _send(self, screen: bytes, patience: float = STALL_SECONDS, *sources: int | Signals) -> None:
        """Write all bytes as the terminal takes them, and heed what comes from ``sources`` meanwhile."""
        self._writing, rest = True, memoryview(screen)
        deadline = time.monotonic() + patience
        while rest:
            ready = self._ready(max(0.0, deadline - time.monotonic()), *sources, writing=True)
            if self._signals in ready:
                self._signalled |= self._signals.noted()
                if self._signalled & {signal.SIGTSTP, signal.SIGCONT}:
                    return self._heed()
            if self._device.input in ready:
                self._receive()
            if self._device.output in ready and (taken := self._device.write(rest)):
                rest, deadline = rest[taken:], time.monotonic() + patience
            elif time.monotonic() >= deadline:
                raise TerminalError(f"the terminal has taken nothing for {patience:.0f} s")
        self._writing = False
        return None

    def _ready(self, timeout: float, *sources: int | Signals, writing: bool = False) -> list[int | Signals]:
        """Return which of ``sources``, by default input and signals, have something; with ``writing``, the
        output too if it takes something, and then only the sources that are named."""
        sources = sources or (() if writing else (self._device.input, self._signals))
        readable, writable, _ = select.select(sources, (self._device.output,) * writing, (), timeout)
        return readable + writable

    def _receive(self) -> None:
        parsed = self._parser.feed(self._read())
        if self._parser.pending:
            more = self._ready(ESCAPE_DELAY, self._device.input)
            parsed += self._parser.feed(self._read()) if more else self._parser.flush()
        for event in parsed:
            if isinstance(event, PixelReport | SizeReport):
                self._measure(event)
                continue
            if isinstance(event, Answered):
                if not self._unanswered:
                    continue
                self._unanswered -= 1
            if len(self._waiting) < MOST_WAITING:
                self._waiting.append(event)

    def _read(self) -> bytes:
        received = self._device.read()
        if self._hearing:
            self._hearing.take(received, REMOTE_SECONDS)
            if len(self._hearing.replies) > _LATE_BYTES:
                self._hearing = None
        return received

    def _heed(self) -> None:
        signals, self._signalled = self._signalled, set()
        if signal.SIGTSTP in signals:
            self.suspend()
        elif signal.SIGCONT in signals:
            # Stopped from outside without notice; the shell has since set the terminal as it likes.
            self._give_back()
            self._take()
            self._waiting.append(Resize(self.size()))
        elif signal.SIGWINCH in signals:
            self._sizes.heed_kernel()
            self._waiting.append(Resize(self.size()))
            self._ask_sizes()

    def _know_sizes(self) -> None:
        self._sizes = Sizes(self._device.window_size, self.profile)
        self._set_mouse_unit()

    def _ask_sizes(self) -> None:
        for kind, question in size_questions(self.profile).items():
            self._sizes_asked[kind] += 1
            self._send(question)

    def _measure(self, report: PixelReport | SizeReport) -> None:
        """Take sizes from an answer or a new size, unless nobody asked for it; another size is a `Resize`."""
        if isinstance(report, SizeReport):
            asked = self.profile.in_band_resize
        else:
            asked = self._sizes_asked[report.kind] > 0
            self._sizes_asked[report.kind] -= asked
        if asked and self._sizes.take(report):
            self._set_mouse_unit()
            self._waiting.append(Resize(self.size()))

    def _set_mouse_unit(self) -> None:
        if self._sizes.cell_size and reports_pixels(self.profile):
            self._parser.mouse_unit = self._sizes.cell_size
