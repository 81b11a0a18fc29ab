"""A scene of fewer splats that looks alike: merged, not skipped."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from tsplat.edit import join, keep_most_important
from tsplat.given import whole
from tsplat.lod.fit import fit
from tsplat.lod.kd import kd_order
from tsplat.lod.levels import Level, coarser, finest
from tsplat.processors import worker_count
from tsplat.rotations import quats_of
from tsplat.scene import Gaussians, a_scene

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]

CHUNK = 1 << 16
"""Covariances taken apart at a time."""


def decimate(
    gaussians: Gaussians, count: int, *, threads: int = 0, progress: Callable[[float], None] | None = None
) -> Gaussians:
    """Merge splats, those first whose merging changes least, until so many are left.

    Parameters
    ----------
    gaussians : Gaussians
        The scene.
    count : int
        How many to keep, at least 1; a scene of no more is returned as it is.
    threads : int
        How many work at it; 0 means one per available processor.
    progress : callable, optional
        Called with the fraction done.

    Returns
    -------
    Gaussians
        In an order of space, not of the scene; last those that are beyond all measure for it: up to a half of
        ``count``, which are not merged.

    Raises
    ------
    OptionError
        ``count`` is below 1.
    SceneError
        The scene is none.
    """
    count, threads = whole("count", count, 1), whole("threads", threads, 0, 1024)
    if len(a_scene(gaussians)) <= count:
        return gaussians
    threads, progress = worker_count(threads), progress or (lambda _: None)
    found = fit(gaussians)
    # Not so many that little of the scene would be left.
    giants = keep_most_important(found.giants, max(count // 2, count - len(found.scene)))
    merged = found.in_world(_merged(found.scene, count - len(giants), threads, progress))
    progress(1.0)
    return join([merged, giants]) if len(giants) else merged


def _merged(gaussians: Gaussians, count: int, threads: int, progress: Callable[[float], None]) -> Gaussians:
    if len(gaussians) <= count:
        return gaussians
    level = finest(gaussians, kd_order(gaussians.means, threads), threads)
    while (left := len(level.means)) > 2 * count:
        level = coarser(level, threads)
        progress(1.0 - left / len(gaussians))
    return _gaussians_of(coarser(level, threads, count), gaussians)


def _gaussians_of(level: Level, source: Gaussians) -> Gaussians:
    n = len(level.means)
    quats, scales = np.empty((n, 4), np.float32), np.empty((n, 3), np.float32)
    for first in range(0, n, CHUNK):
        part = slice(first, first + CHUNK)
        quats[part], scales[part] = principal_axes(level.covars[part])
    extra = source.extra and source.extra.of_others(n, "their splats were merged")
    return Gaussians(
        level.means, quats, scales, level.opacities, level.sh, source.antialiased, source.up, source.origin, extra
    )


def principal_axes(covars: F32) -> tuple[F64, F64]:
    """Return rotations and standard deviations along the rotated axes.

    Parameters
    ----------
    covars : ndarray of float32, [N, 6]
        Upper triangles: xx, xy, xz, yy, yz, zz.

    Returns
    -------
    quats : ndarray of float64, [N, 4]
        ``wxyz``, unit length.
    scales : ndarray of float64, [N, 3]
        In world units, growing, 0 or more.
    """
    full = covars.astype(np.float64)[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
    variances, axes = np.linalg.eigh(full)
    axes *= np.sign(np.linalg.det(axes))[:, None, None]  # a rotation, no mirror
    return quats_of(axes), np.sqrt(np.maximum(variances, 0.0))
