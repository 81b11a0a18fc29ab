"""What a person does in the viewer: the bytes their terminal got, or the views they saw, to be drawn again."""

from __future__ import annotations

import time
from bisect import bisect_right
from dataclasses import replace
from types import TracebackType
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from tsplat import images
from tsplat.drawing import draw_all
from tsplat.errors import SaveError
from tsplat.record.cast import CELLS, FRESH, Cast
from tsplat.terminal import Event, Profile, Resize, Session
from tsplat.viewer.picture import Drawn, Painter, saturated
from tsplat.viewer.recorder import Recorder
from tsplat.viewer.scenes import Scenes
from tsplat.viewer.state import ViewerState, picture

U8 = npt.NDArray[np.uint8]

QUESTION = b"\x1b[5n"
"""Asks a terminal whether it has got so far; one that plays the recording would answer it too."""


class CastSession(Session):
    """A session that also writes what is shown, and when, to an asciicast."""

    def __init__(self, file: BinaryIO, title: str) -> None:
        super().__init__()
        self._file, self._title = file, title
        self._cast: Cast | None = None
        self._start = 0.0

    def __enter__(self) -> CastSession:
        super().__enter__()
        self._start, size = time.perf_counter(), self.size()
        about = {"timestamp": int(time.time()), "title": self._title}
        self._cast = Cast(self._file, size.columns, size.rows, **about)
        self._cast.output(0.0, FRESH)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        cast, self._cast = self._cast, None  # what gives the terminal back is not part of what is shown
        try:
            if cast and kind is None:
                cast.end(self._seconds)
        finally:
            super().__exit__(kind, error, trace)

    @property
    def _seconds(self) -> float:
        return time.perf_counter() - self._start

    def write(self, screen: bytes) -> None:
        """Write all bytes, and note when they were sent; see `Session.write`."""
        if self._cast:
            self._cast.output(self._seconds, screen.replace(QUESTION, b""))
        super().write(screen)

    def events(self, timeout: float) -> list[Event]:
        """Return what happened, and note new sizes; see `Session.events`."""
        events = super().events(timeout)
        for event in events:
            if isinstance(event, Resize) and self._cast:
                self._cast.resize(self._seconds, event.size.columns, event.size.rows)
        return events


class CastRecorder(Recorder):
    """Records what the terminal got.

    Parameters
    ----------
    file : binary file
        Open for writing, empty.
    title : str
        What players call it.
    """

    def __init__(self, file: BinaryIO, title: str) -> None:
        self.file, self.title = file, title

    def session(self) -> Session:
        """Return a session that is recorded."""
        return CastSession(self.file, self.title)

    def takes(self, output: str) -> bool:
        """Return whether players draw it."""
        return output in CELLS


class ViewRecorder(Recorder):
    """Records what was seen and when, not the pixels: they are drawn again, at any size, by `Replay`.

    Attributes
    ----------
    times : list of float
        When each view came, in seconds on the clock of `time.perf_counter`.
    views : list of ViewerState
        What was seen from then on.
    """

    def __init__(self) -> None:
        self.times: list[float] = []
        self.views: list[ViewerState] = []

    def painter(self, scenes: Scenes, profile: Profile) -> Painter:
        """Return a painter that tells what it draws."""
        return _TellingPainter(scenes, profile, self)

    def saw(self, state: ViewerState) -> None:
        """Note what is drawn now."""
        view = picture(state)
        if not self.views or self.views[-1] != view:
            self.times.append(time.perf_counter())
            self.views.append(view)


class _TellingPainter(Painter):
    def __init__(self, scenes: Scenes, profile: Profile, recorder: ViewRecorder) -> None:
        super().__init__(scenes, profile)
        self.recorder = recorder

    def draw(self, state: ViewerState, *args: Any, **kwargs: Any) -> Drawn:
        self.recorder.saw(state)
        return super().draw(state, *args, **kwargs)


class Replay:
    """The frames of a session at a constant rate; each shows the last view that had come by then.

    Parameters
    ----------
    recorder : ViewRecorder
        Of a session that is over.
    scenes : SceneVariants or OnDisk
        The scene that was seen.
    size : tuple of 2 ints
        Width and height of a frame in pixels.
    fps : int
        Frames a second.
    end : float
        When the session ended, on the same clock.

    Raises
    ------
    SaveError
        Nothing was seen.
    """

    def __init__(
        self, recorder: ViewRecorder, scenes: Scenes, size: tuple[int, int], fps: int, end: float
    ) -> None:
        if not recorder.views:
            raise SaveError("nothing is recorded: the viewer was left before its first picture")
        self.recorder, self.scenes, self.size, self.fps = recorder, scenes, size, fps
        self._count = max(1, round((end - recorder.times[0]) * fps))
        self._last: tuple[int, U8] | None = None

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: int) -> U8:
        view = bisect_right(self.recorder.times, self.recorder.times[0] + index / self.fps) - 1
        if self._last is None or self._last[0] != view:
            self._last = view, self._drawn(self.recorder.views[view])
        return self._last[1]

    def _drawn(self, view: ViewerState) -> U8:
        scene = self.scenes.variant(view.kept, view.raw_opacity)
        camera = view.pose.camera(*self.size, view.fov_y)
        colors = draw_all(scene, camera, replace(view.options, depths=False)).colors
        return images.quantize(saturated(colors, view.saturation))
