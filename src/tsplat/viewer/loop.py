"""The thin shell around the pure core: poll, update, draw, one write a frame.

While something changes, frames are as good as the link to the terminal allows, and none is sent before those on
their way have arrived. Once nothing changes, the last one is replaced by the whole picture, piece by piece.
"""

from __future__ import annotations

import contextlib
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Protocol

from tsplat.decode import make_ready
from tsplat.errors import CorruptFileError, LoadError, TerminalError, TsplatError
from tsplat.terminal import outputs
from tsplat.terminal.keys import Answered, Event, Resize
from tsplat.terminal.pacing import DEAF_SECONDS, FULL, STALL_SECONDS, Pacer, Quality
from tsplat.terminal.probe import Profile
from tsplat.viewer.file_watch import CHANGED, FileWatch
from tsplat.viewer.hud import Measured, layout
from tsplat.viewer.picture import HOME, Drawn, Painter, empty_cell, free_path
from tsplat.viewer.spans import Span, erased
from tsplat.viewer.starts import Starts
from tsplat.viewer.state import Notice, Tick, ViewerState, overlay, picture
from tsplat.viewer.update import update
from tsplat.warmup import WarmUp

FRAME_SECONDS = 1.0 / 60.0
REST_SECONDS = 3600.0
READING_SECONDS = 0.1
"""Between looks at how much of a scene was read meanwhile."""

SETTLE_SECONDS = 0.3
"""Some terminals drop pictures that come while they are busy with a new size: then it is drawn once more."""

NOTICE_SECONDS = 0.2
"""A start that is quicker than this shows no notice."""

ERASE_SCREEN = b"\x1b[2J"
ONE_SEQUENCE = ("sixel", "iterm2")
"""Outputs whose pictures are part of the screen: what clears that clears them."""
STARTING = "starting"


class Terminal(Protocol):
    """What the loop needs of `tsplat.terminal.Session`."""

    profile: Profile
    question: bytes

    def events(self, timeout: float) -> list[Event]: ...
    def write(self, screen: bytes) -> None: ...
    def synchronized(self, screen: bytes) -> bytes: ...
    def suspend(self) -> None: ...


@dataclass(frozen=True, slots=True)
class Screen:
    """What was written last: the seen part of the state, its text, the picture's way there, and how good it is.

    And how much of the scene was read before.
    """

    seen: tuple[object, ...]
    spans: list[Span]
    drawn: Drawn
    picture: ViewerState
    quality: Quality
    read: float


class Viewer:
    """Runs a session from its first frame to the key that ends it.

    Parameters
    ----------
    session : Terminal
        An entered session.
    painter : Painter
        Draws the scene.
    state : ViewerState
        Where to begin.
    name : str
        What pictures saved by P are called.
    folder : Path
        Where they go.
    pacer : Pacer, optional
        Says when the next frame may be sent and how good it may be.
    starts : Starts, optional
        Where a session begins, and where it goes on when something else is to be up.
    """

    def __init__(
        self,
        session: Terminal,
        painter: Painter,
        state: ViewerState,
        name: str,
        folder: Path,
        pacer: Pacer | None = None,
        starts: Starts | None = None,
    ) -> None:
        self.session, self.painter, self.state = session, painter, state
        self.name, self.folder = name, folder
        self.pacer, self.starts = pacer or Pacer(), starts
        self.watch = FileWatch(painter.file)
        self.pieces: Iterator[bytes] | None = None
        self.next_frame = 0.0
        self.settled: float | None = None
        self.screen: Screen | None = None
        self.intervals: deque[float] = deque(maxlen=20)
        self.last_start = 0.0
        self.rested = True
        self.last_ms = {"encode": 0.0, "write": 0.0}

    def run(self) -> None:
        """Draw and obey until a key ends it; no picture stays behind."""
        try:
            self._run()
        except TerminalError:
            self.painter.clear()  # there is nobody to write to
            raise
        except BaseException:
            with contextlib.suppress(TerminalError):
                self.clear()
            raise
        self.clear()

    def _run(self) -> None:
        self.warm_up()
        if self.starts and self.state.running:
            self.state = self.starts.settled(self.state)
        self.send(b"")  # how long the way is shows best on a frame of nothing
        last_tick: float | None = None
        while self.state.running:
            wait = self.step(time.perf_counter())
            if not wait:
                continue
            self.take(self.session.events(min(wait, self.watch.left(time.perf_counter()))))
            now = time.perf_counter()
            if self.watch.changed(now):
                self.say(CHANGED)
            if self.state.moving:
                # The first tick after a rest stands for one frame, so that a key acts at once.
                self.state = update(self.state, Tick(now - last_tick if last_tick else FRAME_SECONDS))
            last_tick = now if self.state.moving else None

    def clear(self) -> None:
        """Take the pictures off the screen."""
        if pictures := self.painter.clear():
            self.session.write(pictures)

    def step(self, now: float) -> float:
        """Send what is due; return how many seconds there is nothing to send, 0 when something was sent."""
        if self.settled is not None and now >= self.settled:
            self.settled, self.state = None, replace(self.state, screens=self.state.screens + 1)
        reading = self.painter.read < 1.0
        coarse = self.screen is not None and self.screen.quality != FULL
        unfinished = coarse and not reading and not self.state.moving
        if not self.changed and not unfinished:
            self.rested |= not self.state.moving
            if self.state.moving:
                return FRAME_SECONDS
            if self.settled is not None:
                return self.settled - now
            if reading:
                return READING_SECONDS
            return STALL_SECONDS if self.pacer.waiting and self.pacer.due(now) else REST_SECONDS
        due = max(self.next_frame, self.pacer.due(now))
        if due > now:
            return due - now
        if not self.changed and self.pacer.waiting:
            return DEAF_SECONDS  # a key that comes now should have to wait for one piece at most
        self.next_frame = now + FRAME_SECONDS
        if self.changed:
            self.show(now)
        else:
            self.refine()
        return 0.0

    @property
    def changed(self) -> bool:
        """Whether the screen no longer shows the state, or not all that was read of the scene."""
        screen = self.screen
        return screen is None or screen.seen != _seen(self.state) or screen.read != self.painter.read

    def take(self, events: list[Event]) -> None:
        """Obey events; do what a state can only ask for."""
        for event in events:
            if isinstance(event, Answered):
                self.pacer.answered(time.perf_counter())
                continue
            if isinstance(event, Resize):
                self.pacer.restart()  # the terminal may have been given back in between, answers and all
                self.learn()
                if self.state.output in ONE_SEQUENCE:
                    self.settled = time.perf_counter() + SETTLE_SECONDS
            before, self.state = self.state, update(self.state, event)
            if self.state.pictures != before.pictures:
                self.save_picture()
            if self.state.ups != before.ups and self.starts:
                self.state = self.starts.turned(self.state)
            if self.state.reloads != before.reloads and self.painter.file:
                self.reload()
            if self.state.suspends != before.suspends:
                self.session.suspend()

    def learn(self) -> None:
        """Take over what the terminal answered only now."""
        profile = self.session.profile
        if profile is not self.painter.profile:
            self.clear()
            self.painter.encoder = None  # it was made for the terminal as it was thought to be
            self.painter.profile, known = profile, outputs(profile)
            known = known if self.state.output in known else (self.state.output, *known)
            self.state = replace(self.state, outputs=known, releases=profile.kitty_keyboard)

    def save_picture(self) -> None:
        """Save the view and say where, or why not."""
        try:
            path = self.painter.save(self.state, free_path(self.folder, self.name))
        except TsplatError as error:
            text = str(error)
        else:
            text = f"saved {path.name} in {path.parent}"
        self.say(text)

    def say(self, text: str) -> None:
        """Show a line at the bottom of the screen."""
        self.state = update(self.state, Notice(text))

    def reload(self) -> None:
        """Open the scene's file anew, or say why that cannot be."""
        try:
            self.state = update(self.state, self.painter.reload())
        except LoadError as error:
            self.say(error.problem)
        else:
            self.watch, self.screen = FileWatch(self.painter.file), None

    def show(self, start: float) -> None:
        """Draw the state as well as the link allows: one write, the picture first and the text above it."""
        state, screen, read = self.state, self.screen, self.painter.read
        # A scene on disk shows at once, merged, and is read while that is looked at.
        exact = not state.moving and (screen is not None or not state.on_disk)
        quality = replace(self.pacer.quality, exact=exact)
        abandoned = self.painter.abandon() if self.pieces else b""
        self.pieces = None
        fresh = self._fresh_screen()
        drawn = self._drawn(picture(state), quality)
        quality = replace(quality, exact=drawn.exact)
        spans = layout(state, self.measured(drawn, start))
        before_encode = time.perf_counter()
        encoded, text = self.painter.encode(state, drawn.frame, spans, quality.fidelity)
        stale = erased(screen.spans, spans, empty_cell(state)) if screen and not fresh else b""
        body = self.session.synchronized(stale + HOME + encoded.draw + text)
        before_write = time.perf_counter()
        size = self.send(abandoned + fresh + encoded.upload + body)
        end = time.perf_counter()
        self.pacer.drew(size, before_write - start)
        self.last_ms = {"encode": 1e3 * (before_write - before_encode), "write": 1e3 * (end - before_write)}
        if self.rested:
            self.intervals.clear()
        else:
            self.intervals.append(start - self.last_start)
        self.last_start, self.rested = start, False
        self.screen = Screen(_seen(state), spans, drawn, picture(state), quality, read)

    def refine(self) -> None:
        """Send the next piece of the whole picture."""
        assert self.screen is not None
        if self.pieces is None:
            drawn = self._drawn(picture(self.state), FULL)
            self.screen = replace(self.screen, drawn=drawn)
            size = self.pacer.piece
            self.pieces = self.painter.pieces(self.state, drawn.frame, self.screen.spans, size)
        piece = next(self.pieces, None)
        if piece is None:
            self.pieces, self.screen = None, replace(self.screen, quality=FULL)
        else:
            self.send(piece if self.painter.divisible else self.session.synchronized(piece))

    def send(self, screen: bytes) -> int:
        """Write with a question behind it; return how many bytes that were."""
        asked = screen + self.session.question
        # Noted before, for the writing itself waits where the link is slow.
        self.pacer.sent(time.perf_counter(), len(asked))
        self.session.write(asked)
        return len(asked)

    def _drawn(self, wanted: ViewerState, quality: Quality) -> Drawn:
        screen = self.screen
        if screen and screen.picture == wanted:
            drawn = screen.drawn
            if drawn.density == quality.density and drawn.exact >= quality.exact:
                return drawn
        try:
            return self.painter.draw(self.state, quality.density, exact=quality.exact)
        except CorruptFileError:
            if screen is None:
                raise
            if not self.state.message:  # which may say why it could not be loaded again
                self.say(CHANGED)
            return screen.drawn  # the picture stays

    def _fresh_screen(self) -> bytes:
        """Return what empties the screen before its first picture, after resizing and between outputs."""
        last, old = self.screen, self.painter.encoder
        if last and old and old.name == self.state.output and last.seen[-1] == self.state.screens:
            return b""
        if old:
            old.forget(None)
        return (old.clear() if old else b"") + empty_cell(self.state) + ERASE_SCREEN

    def measured(self, drawn: Drawn, start: float) -> Measured:
        """Return what the HUD shows besides the state."""
        profile = self.session.profile
        if self.intervals:
            seconds = sum(self.intervals) / len(self.intervals)
        else:
            seconds = max(FRAME_SECONDS, time.perf_counter() - start + 1e-3 * sum(self.last_ms.values()))
        height, width = drawn.frame.shape[:2]
        return Measured(
            fps=1.0 / seconds,
            visible=drawn.visible,
            width=width,
            height=height,
            stage_ms=drawn.stage_ms | self.last_ms,
            terminal=f"{profile.program} {profile.version}".strip(),
            protocol=detected(profile),
            detail=self.painter.detail_status(drawn),
        )

    def warm_up(self) -> None:
        """Compile or load the kernels with a notice on screen, ready to be told to stop."""
        start = time.perf_counter()
        kernels = WarmUp(partial(self.painter.warm_up, self.state)).start()
        while not kernels.done(0.01) and self.state.running:
            self.take(self.session.events(0.0))
            if time.perf_counter() - start > NOTICE_SECONDS:
                self.session.write(self.session.synchronized(self.notice(kernels.notice() or STARTING)))
                kernels.done(0.1)
        if kernels.compiling:  # the first run: the next ones read files with these
            WarmUp(make_ready).start()

    def notice(self, text: str) -> bytes:
        """Return what shows, in the middle of the screen, that something goes on."""
        size = self.state.size
        shown = f" {text} "[: size.columns]  # the spaces erase what a longer text left
        return f"\x1b[{(size.rows + 1) // 2};{(size.columns - len(shown)) // 2 + 1}H{shown}".encode()


def detected(profile: Profile) -> str:
    """Return what was found out about a terminal, in a few words."""
    found = {
        "kitty": profile.kitty_graphics,
        "sixel": profile.sixel,
        "24-bit": profile.colors > 256,
        "sync": profile.synchronized,
        "keys": profile.kitty_keyboard,
    }
    return ", ".join(name for name, present in found.items() if present) or "256 colours only"


def _seen(state: ViewerState) -> tuple[object, ...]:
    return picture(state), *overlay(state)
