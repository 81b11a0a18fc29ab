"""Runs of splats that stand for one another, as nodes of a tree: packed into blocks, bounded, and compared."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tsplat._jit import kernel
from tsplat._threads import FIRST_FREE, claim, new_team
from tsplat.io.arrays import Arrays
from tsplat.raster.prepare import BLOCK, Target, covariance_of, pack_block
from tsplat.raster.workers import on_threads

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]


def pack_runs(splats: Arrays, ends: I64, blocks: I32, target: Target, threads: int) -> None:
    """Fill the blocks of runs that lie one behind the other.

    Parameters
    ----------
    splats : Arrays
        The splats of all, and one more that fills blocks that have none.
    ends : ndarray of int64, [R + 1]
        Where each run begins, and the last one ends.
    blocks : ndarray of int32, [R + 1]
        The first block of each run, of which there are enough, and the one after the last.
    target : Target
        Of a prepared scene.
    threads : int
        How many work at it.
    """
    run = np.repeat(np.arange(len(blocks) - 1), np.diff(blocks))
    place = np.arange(blocks[0], blocks[-1]) - blocks[run]
    rows = np.stack([ends[run] + BLOCK * place, ends[run] + BLOCK * (place + 1)], axis=1)
    rows = np.minimum(rows, ends[run + 1][:, None])
    rows[rows[:, 0] == rows[:, 1]] = ends[-1], ends[-1] + 1
    team = new_team(1)
    eights = np.empty((threads, 8), np.float32)
    on_threads(threads, team, _pack_blocks.on(_Job(team, rows, int(blocks[0]), *splats, eights, target)))


class _Job(NamedTuple):
    """``rows`` are where each block begins and ends, ``eights`` is room for eight numbers for each worker."""

    team: I64
    rows: I64
    first: int
    means: F32
    quats: F32
    scales: F32
    opacities: F32
    sh: F32
    eights: F32
    target: Target


@kernel
def _pack_blocks(worker, job):
    target = job.target
    padded = len(target.log2_opacities)
    while True:
        number = claim(job.team, FIRST_FREE)
        if number >= len(job.rows):
            return
        start, end, block = job.rows[number, 0], job.rows[number, 1], job.first + number
        largest = np.float32(0.0)
        for i in range(start, end):
            covariance_of(job.quats, job.scales, i, target.covars, block * BLOCK + i - start, padded)
            for axis in range(3):
                largest = max(largest, job.scales[i, axis])
        pack_block(block, job.means, job.opacities, job.sh, start, end, largest, job.eights[worker], target)


class Summary(NamedTuple):
    """What is known of some runs.

    Attributes
    ----------
    boxes : ndarray of float32, [R, 6]
        Least and largest coordinates of the centres; those of a run of none hold nothing.
    largest : ndarray of float32, [R]
        The largest scale of a splat.
    sizes : ndarray of float32, [R]
        See `Hierarchy`.
    masses : ndarray of float64, [R, 2]
        The sum of opacity times area, and of its square times area.
    """

    boxes: F32
    largest: F32
    sizes: F32
    masses: F64


def summarize(splats: Arrays, ends: I64) -> Summary:
    """Return what is to be known of runs; see `pack_runs` for the parameters."""
    some = ends[:-1] < ends[1:]

    def over_runs(reduce: np.ufunc, values: F64 | F32, nothing: float) -> npt.NDArray[np.floating]:
        reduced = reduce.reduceat(values, ends)[:-1]  # what is behind the last run is one of its own
        reduced[~some] = nothing
        return reduced

    variances = splats.scales.astype(np.float64) ** 2
    areas = np.sqrt((variances * np.roll(variances, 1, axis=1)).sum(axis=1) / 3.0)
    masses = splats.opacities * areas
    sums = np.stack([over_runs(np.add, each, 0.0) for each in (masses, splats.opacities * masses)], axis=1)
    sizes = np.sqrt(over_runs(np.add, masses * areas, 0.0) / np.maximum(sums[:, 0], TINY))
    low, high = over_runs(np.minimum, splats.means, np.inf), over_runs(np.maximum, splats.means, -np.inf)
    largest = over_runs(np.maximum, splats.scales.max(axis=1), 0.0)
    return Summary(np.concatenate([low, high], axis=1), largest, sizes.astype(np.float32), sums)


TINY = 1e-30
"""Square world units, of splats that are not there."""


def lost(coarse: F64, fine: F64) -> F64:
    """Return what a picture loses by runs in place of finer ones; see `Summary.masses`.

    It is how far they are from covering as much and as densely; docs/levels-of-detail.md says what else was tried.
    """
    difference: F64 = np.abs(coarse - fine).sum(axis=1)
    return difference
