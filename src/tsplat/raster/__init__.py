"""A scene and a camera become an image, on the CPU: project, colour, bin, then sort and blend tile by tile."""

from __future__ import annotations

import time

import numpy as np

from tsplat.camera import Camera
from tsplat.raster.bin import bin_tiles
from tsplat.raster.composite import TILE, composite_tiles
from tsplat.raster.prepare import prepared
from tsplat.raster.project import project
from tsplat.raster.sh import color_visible
from tsplat.raster.workers import on_threads
from tsplat.rendering import Rendering, RenderOptions
from tsplat.scene import Gaussians

__all__ = ["rasterize"]


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
    threads = options.worker_count
    scene = prepared(gaussians, threads)
    shape = (camera.height, camera.width)
    colors, alphas = np.empty((*shape, 3), np.float32), np.empty(shape, np.float32)
    depths = np.empty(shape, np.float32) if options.depths else None
    clock = [time.perf_counter()]
    with scene.lock:
        visible = project(scene, camera, options, TILE)
        clock.append(time.perf_counter())
        color_visible(scene, gaussians, camera, options)
        clock.append(time.perf_counter())
        tile_columns, tile_rows = -(-camera.width // TILE), -(-camera.height // TILE)
        isect_offsets = bin_tiles(scene, tile_columns, tile_columns * tile_rows, threads)
        clock.append(time.perf_counter())
        on_threads(threads, composite_tiles, np.zeros(1, np.int64), tile_columns, isect_offsets, scene.isect_keys,
                   scene.records, scene.records.reshape(-1), np.asarray(options.background, np.float32),
                   colors, alphas, depths)  # fmt: skip
        clock.append(time.perf_counter())
    stages = ("project", "sh", "bin", "composite")
    stage_ms = {name: 1e3 * (end - start) for name, start, end in zip(stages, clock, clock[1:], strict=False)}
    return Rendering(colors, alphas, depths, visible, stage_ms)
