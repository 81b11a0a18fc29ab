"""Draw the views, thread counts taking turns, and keep how long each frame and its stages took."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import astuple

from tsplat.bench.results import FRAME, Ceilings, SceneResult, ThreadRun, ViewTimes
from tsplat.bench.views import VIEWS, View, camera_path
from tsplat.options import near_plane
from tsplat.raster import rasterize
from tsplat.raster.ceilings import blends_per_second, copy_bytes_per_second, project_bytes
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians

WARM_UP = 2
"""Frames of each view that are not counted: the first compile kernels, grow buffers and touch new pages."""


def measure_all(
    scenes: Sequence[tuple[str, Gaussians]],
    sizes: Sequence[tuple[int, int]],
    thread_counts: Sequence[int],
    frames: int,
    show: Callable[[str, float], None],
) -> tuple[list[SceneResult], Ceilings]:
    """Time every scene at every size, and the ceilings before and after, as other programs come and go.

    Parameters
    ----------
    scenes : sequence of (str, Gaussians)
        What to draw, and what it is called.
    sizes, thread_counts, frames
        As for `measure`, but several sizes.
    show : callable
        Called between frames with what is being done and the share of it all that is done, 0 to 1.

    Returns
    -------
    list of SceneResult
        One for each scene and size, in the order given.
    Ceilings
        The higher of those before and after.

    Raises
    ------
    CameraError
        A size is out of its range.
    """
    total = len(scenes) * len(sizes) * VIEWS * len(thread_counts) * (WARM_UP + frames)
    done = 0

    def after_frame() -> None:
        nonlocal done
        done += 1
        show(doing, done / total)

    show(doing := "what this machine can do", 0.0)
    before, results = measure_ceilings(), []
    for name, gaussians in scenes:
        for width, height in sizes:
            show(doing := f"{name} {width} x {height}", done / total)
            results.append(measure(gaussians, name, (width, height), thread_counts, frames, after_frame))
    after = measure_ceilings()
    return results, Ceilings(*map(max, astuple(before), astuple(after)))


def measure(
    gaussians: Gaussians,
    name: str,
    size: tuple[int, int],
    thread_counts: Sequence[int],
    frames: int,
    after_frame: Callable[[], None],
) -> SceneResult:
    """Time a scene at one size.

    Parameters
    ----------
    gaussians : Gaussians
        What to draw, with its spherical harmonics as stored.
    name : str
        What the scene is called in the result.
    size : tuple of 2 ints
        Width and height of the image in pixels.
    thread_counts : sequence of int
        Numbers of threads, at least 1 each, without repeats.
    frames : int
        Frames counted of each view on each number of threads, at least 1.
    after_frame : callable
        Called after each frame, while no clock runs.

    Returns
    -------
    SceneResult

    Raises
    ------
    CameraError
        The size is out of its range.
    """
    views = camera_path(gaussians, *size)
    times = {threads: [ViewTimes(view.name) for view in views] for threads in thread_counts}
    for turn in range(WARM_UP + frames):
        # Whoever draws a view second finds it in the caches, so they take turns at being first.
        first = turn % len(thread_counts)
        for index, view in enumerate(views):
            for threads in (*thread_counts[first:], *thread_counts[:first]):
                _draw(gaussians, view, threads, times[threads][index], counted=turn >= WARM_UP)
                after_frame()
    runs = tuple(ThreadRun(threads, tuple(each)) for threads, each in times.items())
    return SceneResult(name, len(gaussians), gaussians.sh_degree, *size, frames, runs)


def measure_ceilings() -> Ceilings:
    """Return what one thread of this machine can do at most, as of now."""
    return Ceilings(blends_per_second(), copy_bytes_per_second())


def _draw(gaussians: Gaussians, view: View, threads: int, times: ViewTimes, *, counted: bool) -> None:
    options = RenderOptions(threads=threads, depths=False, near_plane=near_plane(gaussians))
    start = time.perf_counter()
    rendering = rasterize(gaussians, view.camera, options)
    milliseconds = {**rendering.stage_ms, FRAME: 1e3 * (time.perf_counter() - start)}
    if not counted:
        return
    for stage, each in milliseconds.items():
        times.milliseconds.setdefault(stage, []).append(float(each))
    times.visible, times.pairs, times.blends = rendering.visible, rendering.pairs, rendering.blends
    times.project_bytes = project_bytes(gaussians, rendering, options)
