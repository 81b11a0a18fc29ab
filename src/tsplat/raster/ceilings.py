"""What this machine could do at most: bounds that the stages of a frame are measured against."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tsplat._bits import BATCH
from tsplat._jit import kernel
from tsplat._threads import new_team
from tsplat.raster import member as col
from tsplat.raster import record
from tsplat.raster.buffers import aligned
from tsplat.raster.composite import blend_cell
from tsplat.raster.falloff import OFFSET, SCALE
from tsplat.raster.prepare import prepared
from tsplat.raster.tile import CELL_SIZE
from tsplat.raster.workers import on_threads
from tsplat.rendering import Rendering, RenderOptions
from tsplat.scene import Gaussians

F32 = npt.NDArray[np.float32]

REPEATS = 7
ROUNDS = 2000
"""Batches blended in a row: about a millisecond."""

COPY_BYTES = 64 << 20

RECORD_BYTES = 4 * record.LENGTH + 4 + 8
"""Of a visible splat: its record, its sort key, and its first and last tile."""


class _Blending(NamedTuple):
    """What `_blend_rounds` works on: a cell of each worker, and a batch that all of them read."""

    rounds: int
    cells: F32
    batch: F32


def blends_per_second(threads: int = 1, rounds: int = ROUNDS, repeats: int = REPEATS) -> float:
    """Return how often a second threads blend a splat into a cell when nothing leaves their first-level caches.

    It is the very function that `composite` calls, with a full batch and cells that never fill.

    Parameters
    ----------
    threads : int
        How many, at least 1; the rate is that of all together.
    rounds : int
        Batches that each of them blends in a row.
    repeats : int
        How many times that is measured, for the quickest to count.
    """
    cells, batch = aligned(threads * CELL_SIZE, np.float32), aligned((BATCH + 1) * col.LENGTH, np.float32)
    batch[:] = 0.0
    rows = batch.reshape(BATCH + 1, col.LENGTH)
    rows[:, [col.CONIC_A, col.CONIC_C]] = -0.01 * SCALE
    rows[:, col.PEAK], rows[:, col.CUT] = -18.0 * SCALE + OFFSET, -30.0 * SCALE + OFFSET
    rows[:, [col.RED, col.GREEN, col.BLUE]] = 0.5
    team, work = new_team(0), _blend_rounds.on(_Blending(rounds, cells, batch))

    def blend() -> None:
        cells[:] = 0.0
        cells.reshape(threads, CELL_SIZE)[:, :16] = 1.0
        on_threads(threads, team, work)

    return threads * rounds * BATCH / _shortest(blend, repeats)


@kernel
def _blend_rounds(worker, job):
    cell = job.cells[worker * CELL_SIZE : (worker + 1) * CELL_SIZE]
    for _ in range(job.rounds):
        blend_cell(cell, 0, 0, 0, job.batch, ~np.uint64(0), None)


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


def _shortest(function: Callable[[], object], repeats: int = REPEATS) -> float:
    """Return the seconds that the quickest of a few calls took, after one that is not counted."""
    function()
    best = float("inf")
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        best = min(best, time.perf_counter() - start)
    return best
