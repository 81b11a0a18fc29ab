"""A scene and a camera become an image, on the CPU: project, sort, bin, composite."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from tsplat._threads import new_team
from tsplat.camera import Camera
from tsplat.raster.bin import room
from tsplat.raster.cells import TILE
from tsplat.raster.draw import draw
from tsplat.raster.frame import BLENDS, STAGES, VISIBLE, Frame, Image, Window, new_frame, new_image, sight, whole
from tsplat.raster.prepare import BLOCK, Prepared, prepared
from tsplat.raster.soften import SOFTEN, soften
from tsplat.raster.windows import blocks_in_sight, divided, most_pairs, parts_for
from tsplat.raster.workers import on_threads
from tsplat.rendering import Rendering, RenderOptions
from tsplat.scene import Gaussians

__all__ = ["rasterize", "rasterize_blocks"]


def rasterize(gaussians: Gaussians, camera: Camera, options: RenderOptions) -> Rendering:
    """Draw a scene.

    Parameters
    ----------
    gaussians : Gaussians
        What to draw; what no camera changes is worked out on the first call and kept.
    camera : Camera
        From where, and how large.
    options : RenderOptions
        How.

    Returns
    -------
    Rendering
        The same bits for the same arguments, whatever the number of threads.
    """
    scene = prepared(gaussians, options.worker_count)
    return rasterize_blocks(scene, scene.blocks, camera, options)


def rasterize_blocks(
    scene: Prepared, blocks: npt.NDArray[np.int32], camera: Camera, options: RenderOptions
) -> Rendering:
    """Draw some blocks of a scene, as `rasterize` would if there were no others."""
    with scene.lock:
        image, totals = new_image(scene, camera, options), _Totals()
        windows = [whole(camera.width, camera.height)]
        while windows:
            window = windows.pop()
            parts = _draw_window(scene, blocks, camera, options, image, window, totals)
            if parts > 1:
                windows += divided(window, parts, columns=-(-camera.width // TILE))
        variance = options.softening(math.sqrt(float(camera.K[0, 0] * camera.K[1, 1])))
        if variance > 0.0:
            start = time.monotonic_ns()
            image = soften(image, variance, options.worker_count, new_team(1), scene.buffers)
            totals.stage_ms[SOFTEN] = 1e-6 * (time.monotonic_ns() - start)
    shape = camera.height, camera.width
    colors, alphas, depths = image.colors, image.alphas, image.depths
    return Rendering(
        colors.reshape(*shape, 3), alphas.reshape(shape), None if depths is None else depths.reshape(shape),
        min(totals.visible, BLOCK * len(blocks)), totals.pairs, totals.blends, totals.stage_ms,
    )  # fmt: skip


@dataclass(slots=True)
class _Totals:
    """What the windows of an image add up to, see `Rendering`."""

    visible: int = 0
    pairs: int = 0
    blends: int = 0
    stage_ms: dict[str, float] = field(default_factory=lambda: dict.fromkeys(STAGES, 0.0))

    def add(self, frame: Frame, start: int, pairs: int) -> None:
        """Add what a frame that started at this time has done."""
        results = frame.results.tolist()
        self.visible += results[0][VISIBLE]
        self.pairs += pairs
        self.blends += sum(result[BLENDS] for result in results)
        for stage, end in zip(STAGES, frame.stamps.tolist(), strict=True):
            self.stage_ms[stage] += 1e-6 * (end - start)
            start = end


def _draw_window(
    scene: Prepared, blocks: npt.NDArray[np.int32], camera: Camera, options: RenderOptions,
    image: Image, window: Window, totals: _Totals,
) -> int:  # fmt: skip
    """Draw the tiles of a window; return 1, or into how many parts it is to be divided because memory is short."""
    if parts_for(len(blocks), options, scene.buffers) > 1:
        blocks = blocks_in_sight(blocks, *sight(scene, camera, options, window))
        parts = parts_for(len(blocks), options, scene.buffers)
        if parts > 1 and window.end_tile - window.first_tile > 1:
            return parts
    wanted = most_pairs(2 * BLOCK * len(blocks), len(blocks), options, scene.buffers)
    while True:
        frame = new_frame(scene, blocks, camera, options, wanted, image=image, window=window)
        start = time.monotonic_ns()
        pairs: int = on_threads(options.worker_count, frame.team, draw.on(frame, scene.last_known), meets=True)
        if pairs <= room(frame):
            totals.add(frame, start, pairs)
            return 1
        wanted = pairs
        most = most_pairs(pairs, len(blocks), options, scene.buffers)
        if pairs > most:
            return math.ceil(pairs / most)
