"""What this machine could do at most: bounds that the stages of a frame are measured against."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from tsplat._bits import BATCH
from tsplat._jit import kernel
from tsplat.raster import member as col
from tsplat.raster import record
from tsplat.raster.buffers import aligned
from tsplat.raster.composite import blend_cell
from tsplat.raster.falloff import OFFSET, SCALE
from tsplat.raster.prepare import prepared
from tsplat.raster.tile import CELL_SIZE
from tsplat.rendering import Rendering, RenderOptions
from tsplat.scene import Gaussians

REPEATS = 7
ROUNDS = 2000
"""Batches blended in a row: about a millisecond."""

COPY_BYTES = 64 << 20

RECORD_BYTES = 4 * record.LENGTH + 4 + 8
"""Of a visible splat: its record, its sort key, and its first and last tile."""


def blends_per_second() -> float:
    """Return how often a second one thread blends a splat into a cell when nothing leaves the first-level cache.

    It is the very function that `composite` calls, with a full batch and a cell that never fills.
    """
    cell, batch = aligned(CELL_SIZE, np.float32), aligned((BATCH + 1) * col.LENGTH, np.float32)
    batch[:] = 0.0
    rows = batch.reshape(BATCH + 1, col.LENGTH)
    rows[:, [col.CONIC_A, col.CONIC_C]] = -0.01 * SCALE
    rows[:, col.PEAK], rows[:, col.CUT] = -18.0 * SCALE + OFFSET, -30.0 * SCALE + OFFSET
    rows[:, [col.RED, col.GREEN, col.BLUE]] = 0.5

    def blend() -> None:
        cell[:] = 0.0
        cell[:16] = 1.0
        _blend_rounds(ROUNDS, cell, batch)

    return ROUNDS * BATCH / _shortest(blend)


@kernel
def _blend_rounds(rounds, cell, batch):
    for _ in range(rounds):
        blend_cell(cell, 0, 0, 0, batch, ~np.uint64(0), None)


def copy_bytes_per_second() -> float:
    """Return how many bytes a second one thread reads and writes, both counted, in a plain copy of 64 MB."""
    source, target = np.zeros(COPY_BYTES, np.uint8), np.zeros(COPY_BYTES, np.uint8)
    return 2 * COPY_BYTES / _shortest(lambda: np.copyto(target, source))


def project_bytes(gaussians: Gaussians, rendering: Rendering, options: RenderOptions) -> int:
    """Return how many bytes the project stage of that frame had to read and to write."""
    scene = prepared(gaussians, options.worker_count)
    read = sum(array.nbytes for array in (scene.means, scene.covars, scene.log2_opacities, scene.base_colors))
    used = scene.coefficients_used(options.sh_degree)
    if used:
        read += scene.sh_rest.nbytes * used // scene.coefficients
    return read + RECORD_BYTES * rendering.visible


def _shortest(function: Callable[[], object]) -> float:
    """Return the seconds that the quickest of a few calls took, after one that is not counted."""
    function()
    best = float("inf")
    for _ in range(REPEATS):
        start = time.perf_counter()
        function()
        best = min(best, time.perf_counter() - start)
    return best
