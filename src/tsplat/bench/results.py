"""What was measured, and what follows from it: spreads, rates and shares of the machine's ceilings.

A rate divides the work of one frame of every view by the times of that view's shortest frame: other
programs only ever add to a frame. They can take from a stage, when the thread that holds the watch is
the one that was held up, so a stage's own shortest time is no base for a rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

FRAME = "frame"
"""Name of the whole frame beside its stages; it is timed from outside."""


@dataclass(frozen=True, slots=True)
class Spread:
    """How long something took, in milliseconds: mean, shortest, and percentiles."""

    mean: float
    min: float
    p50: float
    p95: float
    p99: float

    @classmethod
    def of(cls, milliseconds: Sequence[float]) -> Spread:
        """Return the spread of one or more times."""
        times = np.asarray(milliseconds, np.float64)
        p50, p95, p99 = np.percentile(times, (50, 95, 99))
        return cls(float(times.mean()), float(times.min()), float(p50), float(p95), float(p99))


@dataclass(frozen=True, slots=True)
class Ceilings:
    """What one thread of this machine can do at most.

    Attributes
    ----------
    blends_per_second : float
        Splats blended into cells of 4 by 4 pixels by a kernel that never leaves the first-level cache.
    copy_bytes_per_second : float
        Bytes read plus bytes written by a plain copy that fits no cache.
    """

    blends_per_second: float
    copy_bytes_per_second: float


@dataclass(eq=False, slots=True)
class ViewTimes:
    """The frames of one view on one number of threads.

    Attributes
    ----------
    name : str
        Of the view.
    milliseconds : dict of str to list of float
        By stage in the order they run, then the whole frame as `FRAME`; one entry for each frame.
    visible, pairs, blends, project_bytes : int
        Of one frame: splats in view, splat and tile pairs, cells blended, bytes projected from and to.
    """

    name: str
    milliseconds: dict[str, list[float]] = field(default_factory=dict)
    visible: int = 0
    pairs: int = 0
    blends: int = 0
    project_bytes: int = 0

    def of_shortest_frame(self, stage: str) -> float:
        """Return the time of a stage in the shortest frame, in milliseconds, 0 where there is no such stage."""
        frames = self.milliseconds[FRAME]
        return self.milliseconds[stage][frames.index(min(frames))] if stage in self.milliseconds else 0.0


@dataclass(frozen=True, eq=False, slots=True)
class ThreadRun:
    """The frames of every view on one number of threads."""

    threads: int
    views: tuple[ViewTimes, ...]

    @property
    def spreads(self) -> dict[str, Spread]:
        """Spreads over all frames of all views, by stage in the order they run, the whole frame last."""
        stages = dict.fromkeys(stage for view in self.views for stage in view.milliseconds if stage != FRAME)
        times = {
            stage: [time for view in self.views for time in view.milliseconds.get(stage, [])]
            for stage in (*stages, FRAME)
        }
        return {stage: Spread.of(each) for stage, each in times.items() if each}

    @property
    def frame_ms(self) -> float:
        """Shortest whole frame of each view, the mean over the views, in milliseconds."""
        return self._shortest(FRAME) / len(self.views)

    @property
    def blends_per_second(self) -> float | None:
        """Cell blends a second of the composite stage on all threads together; None where none was counted."""
        return _rate(sum(view.blends for view in self.views), self._shortest("composite"))

    def speedup(self, one: ThreadRun | None) -> float | None:
        """Return how many times as fast as ``one`` this is; None where one of them was not measured."""
        return one.frame_ms / self.frame_ms if one and self.frame_ms else None

    def micro_kernel_share(self, ceilings: Ceilings) -> float | None:
        """Return what each thread's composite reaches of the micro-kernel, 1 for all of it; None where unknown."""
        return _share(self.blends_per_second, self.threads * ceilings.blends_per_second)

    def copy_share(self, ceilings: Ceilings) -> float | None:
        """Return what project reaches of a plain copy's bandwidth, both on one thread; None where unknown."""
        if self.threads != 1:
            return None
        rate = _rate(sum(view.project_bytes for view in self.views), self._shortest("project"))
        return _share(rate, ceilings.copy_bytes_per_second)

    def _shortest(self, stage: str) -> float:
        return sum(view.of_shortest_frame(stage) for view in self.views)


@dataclass(frozen=True, eq=False, slots=True)
class SceneResult:
    """One scene at one size, on each number of threads."""

    scene: str
    splats: int
    sh_degree: int
    width: int
    height: int
    frames: int
    runs: tuple[ThreadRun, ...]

    @property
    def one_thread(self) -> ThreadRun | None:
        """The run on one thread, None where it was not asked for."""
        return next((run for run in self.runs if run.threads == 1), None)


def _rate(amount: float, milliseconds: float) -> float | None:
    return 1e3 * amount / milliseconds if amount and milliseconds else None


def _share(rate: float | None, ceiling: float) -> float | None:
    return rate / ceiling if rate and ceiling else None
