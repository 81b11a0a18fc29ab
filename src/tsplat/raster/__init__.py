"""A scene and a camera become an image, on the CPU: project, sort, bin, composite."""

from __future__ import annotations

import math
import time

import numpy as np
import numpy.typing as npt

from tsplat.camera import Camera
from tsplat.raster.bin import room
from tsplat.raster.draw import draw
from tsplat.raster.frame import BLENDS, STAGES, VISIBLE, new_frame
from tsplat.raster.prepare import BLOCK, Prepared, prepared
from tsplat.raster.soften import SOFTEN, soften
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
    threads = options.worker_count
    with scene.lock:
        frame = new_frame(scene, blocks, camera, options, pairs=2 * BLOCK * len(blocks))
        start = time.monotonic_ns()
        pairs = on_threads(threads, frame.team, draw.on(frame, scene.last_known), meets=True)
        if pairs > room(frame):
            frame = new_frame(scene, blocks, camera, options, pairs)
            start = time.monotonic_ns()
            on_threads(threads, frame.team, draw.on(frame, scene.last_known), meets=True)
        ends, results = frame.stamps.tolist(), frame.results.tolist()
        stage_ms = {
            stage: 1e-6 * (end - begin) for stage, begin, end in zip(STAGES, (start, *ends), ends, strict=False)
        }
        image, shape = frame.image, (camera.height, camera.width)
        variance = options.softening(math.sqrt(float(camera.K[0, 0] * camera.K[1, 1])))
        if variance > 0.0:
            start = time.monotonic_ns()
            image = soften(image, variance, threads, frame.team, scene.buffers)
            stage_ms[SOFTEN] = 1e-6 * (time.monotonic_ns() - start)
        colors, alphas, depths = image.colors, image.alphas, image.depths
        return Rendering(
            colors.reshape(*shape, 3), alphas.reshape(shape), None if depths is None else depths.reshape(shape),
            results[0][VISIBLE], pairs, sum(result[BLENDS] for result in results), stage_ms,
        )  # fmt: skip
