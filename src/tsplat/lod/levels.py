"""Levels of detail: first the scene itself, and each next one half as many splats, merged within two blocks."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tsplat._jit import kernel
from tsplat._threads import FIRST_FREE, claim, new_team
from tsplat.lod.merge import merge
from tsplat.lod.merge_scratch import Scratch, keep, new_scratch, of_worker, take
from tsplat.raster.prepare import BLOCK, covariance_of
from tsplat.raster.workers import on_threads
from tsplat.scene import Gaussians

F32 = npt.NDArray[np.float32]
I64 = npt.NDArray[np.int64]


class Level(NamedTuple):
    """Splats by their moments; all but the last block of them are full.

    Attributes
    ----------
    means : ndarray of float32, [N, 3]
        Centres in world units.
    covars : ndarray of float32, [N, 6]
        Upper triangles of the covariances: xx, xy, xz, yy, yz, zz.
    opacities : ndarray of float32, [N]
        From 0 to 1.
    sh : ndarray of float32, [N, K, 3]
        As in `Gaussians`.
    errors : ndarray of float32, [ceil(N / BLOCK)]
        What merging changed in each block, see `tsplat.lod.merge.merge`; 0 where nothing was merged.
    """

    means: F32
    covars: F32
    opacities: F32
    sh: F32
    errors: F32


def finest(gaussians: Gaussians, order: npt.NDArray[np.int32], threads: int) -> Level:
    """Return the scene as a level, in this order."""
    n = len(gaussians)
    level = _empty(n, gaussians.sh.shape[1])
    team = new_team(1)
    job = _GatherJob(team, order, *gaussians.arrays, level, level.covars.reshape(-1))
    on_threads(threads, team, _gather.on(job))
    return level


def coarser(level: Level, threads: int, kept: int | None = None) -> Level:
    """Return a level of half as many splats, or as many as are to be ``kept``, at least half.

    Within any two blocks side by side the pairs that cost least are merged, see `tsplat.lod.merge`.
    """
    n = len(level.means)
    nodes = -(-n // (2 * BLOCK))
    # Two blocks of the scene become one in the next level, the last one what it may.
    ends = np.minimum(np.arange(nodes + 1) * 2 * BLOCK, n)
    starts = -(-ends // 2) if kept is None else -(-ends * kept // n)
    merged = _empty(int(starts[-1]), level.sh.shape[1])
    team = new_team(1)
    scratch = new_scratch(threads, 3 * level.sh.shape[1])
    on_threads(threads, team, _merge_nodes.on(_MergeJob(team, scratch, level, starts, merged)))
    return merged


def _empty(n: int, k: int) -> Level:
    return Level(
        np.empty((n, 3), np.float32),
        np.empty((n, 6), np.float32),
        np.empty(n, np.float32),
        np.empty((n, k, 3), np.float32),
        np.zeros(-(-n // BLOCK), np.float32),
    )


class _GatherJob(NamedTuple):
    team: I64
    order: npt.NDArray[np.int32]
    means: F32
    quats: F32
    scales: F32
    opacities: F32
    sh: F32
    level: Level
    flat_covars: F32


@kernel
def _gather(worker, job):
    n, level = len(job.order), job.level
    while True:
        start = claim(job.team, FIRST_FREE) * BLOCK
        if start >= n:
            return
        for at in range(start, min(start + BLOCK, n)):
            i = job.order[at]
            covariance_of(job.quats, job.scales, i, job.flat_covars, 6 * at, 1)
            level.opacities[at] = job.opacities[i]
            for axis in range(3):
                level.means[at, axis] = job.means[i, axis]
            for k in range(job.sh.shape[1]):
                for channel in range(3):
                    level.sh[at, k, channel] = job.sh[i, k, channel]


class _MergeJob(NamedTuple):
    """``starts`` are where the splats of each node go in ``merged``, and the end."""

    team: I64
    scratch: Scratch
    level: Level
    starts: I64
    merged: Level


@kernel
def _merge_nodes(worker, job):
    scratch = of_worker(job.scratch, worker)
    while True:
        node = claim(job.team, FIRST_FREE)
        if node >= len(job.starts) - 1:
            return
        low = node * 2 * BLOCK
        take(job.level, low, min(low + 2 * BLOCK, len(job.level.means)), scratch)
        job.merged.errors[node] = merge(scratch, job.starts[node + 1] - job.starts[node])
        keep(scratch, job.merged, job.starts[node])
