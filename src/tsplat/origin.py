"""Scenes that lie far from the world's origin for their size, as maps and surveys have them.

float32 places what is a million metres away in steps of 6 cm. So something round is taken off their coordinates in
float64, and kept as `tsplat.scene.Gaussians.origin`; everything that draws sees small numbers.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from tsplat.scene import Gaussians, Vector

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]

SAMPLE = 8192
"""Splats looked at: a median of this many is steady to a percent."""

FAR = 1024.0
"""A scene farther away than this many times its size needs an origin: float32 would place its splats in steps of
an eight thousandth of its size, which is a tenth of a pixel where it fills the screen and a whole one soon."""

FARTHEST = 2.0**40
"""Times its size: farther away, float64 has lost it already."""

ROOM = 8.0
"""The origin is rounded to a power of ten of at least this many sizes: calm, and the same for parts of a scene."""


def find_origin(points: npt.NDArray[np.floating]) -> Vector | None:
    """Return what is to be taken off the coordinates of a scene, or None, as for every ordinary one.

    Parameters
    ----------
    points : ndarray, [N, 3]
        Centres in the world; rows with nan or inf are passed over.
    """
    with np.errstate(invalid="ignore"):
        sample = points[:: 1 + len(points) // SAMPLE].astype(np.float64)
    sample = sample[np.isfinite(sample).all(axis=1)]
    if len(sample) < 2:
        return None
    with np.errstate(over="ignore", invalid="ignore"):
        middle = np.median(sample, axis=0)
        size = 2.0 * float(np.median(np.linalg.norm(sample - middle, axis=1)))
    if not (0.0 < size < math.inf and FAR * size < float(np.abs(middle).max()) < FARTHEST * size):
        return None
    digits = -math.ceil(math.log10(ROOM * size))
    x, y, z = (round(float(value), digits) + 0.0 for value in middle)
    return x, y, z


def take_off(means: F32, origin: Vector) -> None:
    """Subtract an origin from centres in place, in float64."""
    for first in range(0, len(means), SAMPLE):
        part = means[first : first + SAMPLE]
        with np.errstate(all="ignore"):
            part[:] = part.astype(np.float64) - origin


def world_means(gaussians: Gaussians) -> F64:
    """Return the centres in the world, float64 [N, 3]."""
    return gaussians.means.astype(np.float64) + (gaussians.origin or 0.0)


def placed(gaussians: Gaussians, world: F64) -> Gaussians:
    """Return a scene with its centres in other places of the world, its origin such that float32 holds them.

    Parameters
    ----------
    gaussians : Gaussians
        Any scene.
    world : ndarray of float64, [N, 3]
        The new centres.
    """
    origin = find_origin(world)
    with np.errstate(over="ignore"):  # what is beyond float32 is infinite, and refused
        return replace(gaussians, means=(world - (origin or 0.0)).astype(np.float32), origin=origin)


def in_scene(gaussians: Gaussians, point: npt.ArrayLike) -> F64:
    """Return a point of the world, float64 [3], in the coordinates of ``gaussians.means``."""
    return np.asarray(point, np.float64) - (gaussians.origin or 0.0)
