"""Kernels are made ready on a thread while something else goes on: loaded, or compiled on the first run ever."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace

from tsplat import warmup_process
from tsplat._jit import JIT, progress
from tsplat.camera import Camera
from tsplat.rendering import RenderOptions
from tsplat.warmup_process import SIDE, tiny_scene


class WarmUp:
    """Does a job that needs kernels, on a thread that no one has to wait for.

    Parameters
    ----------
    job : callable, optional
        What to do; by default `draw_tiny`.
    """

    def __init__(self, job: Callable[[], None] | None = None) -> None:
        self._job = job or draw_tiny
        # A daemon, so that quitting does not wait for the compiler.
        self._thread = threading.Thread(target=self._job, name="tsplat-warm-up", daemon=True)

    def start(self) -> WarmUp:
        """Start, unless it was started before."""
        if self._thread.ident is None:
            self._thread.start()
        return self

    def done(self, timeout: float) -> bool:
        """Wait for at most this many seconds; return whether the job is done."""
        self._thread.join(timeout)
        return not self._thread.is_alive()

    @property
    def compiling(self) -> float:
        """Seconds since the first kernel began to be compiled; 0 where they are loaded."""
        so_far = progress()
        return so_far.seconds if so_far else 0.0

    def notice(self) -> str:
        """Return what to tell the person who waits; nothing where no kernel is compiled."""
        so_far = progress()
        if so_far is None:
            return ""
        done, total, seconds = so_far
        return f"compiling kernels, first run only: {done} of {total}, {seconds:.0f} s"


def draw_tiny(options: RenderOptions | None = None) -> None:
    """Draw a few splats with arguments of the types that every scene has, and be ready for several threads.

    One thread draws, as this may go on when the process ends.
    """
    from tsplat.raster import crew, rasterize

    if not JIT:
        return
    camera = Camera.look_at(
        (0.0, 0.0, -3.0), (0.0, 0.0, 0.0), (0.0, -1.0, 0.0), width=SIDE, height=SIDE, fov_y=55.0
    )
    options = replace(options or RenderOptions(antialias="relative", depths=False), threads=1)
    _compile_draw(camera, options)
    crew.make_ready()
    rasterize(tiny_scene(), camera, options)


def _compile_draw(camera: Camera, options: RenderOptions) -> None:
    """Load the kernel that draws; where it has to be compiled, have all others compiled meanwhile."""
    from tsplat.raster.draw import draw
    from tsplat.raster.frame import new_frame
    from tsplat.raster.prepare import empty

    scene = empty(1, coefficients=15)
    frame = new_frame(scene, scene.blocks, camera, options, pairs=0)
    if not draw.ready(0, frame):
        warmup_process.start()
        draw.on(frame)
