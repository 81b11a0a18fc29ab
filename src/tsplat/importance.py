"""Which splats matter most, when not all of them may be kept."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]


def area(scales: F32) -> F64:
    """Return the mean of the three shadows that each ellipsoid throws along its own axes, in units of pi.

    Parameters
    ----------
    scales : ndarray of float32, [N, 3]
        Standard deviations in world units, linear, finite.

    Returns
    -------
    ndarray of float64, [N]
        In square world units, finite, 0 or more.
    """
    x, y, z = scales.T.astype(np.float64)
    mean: F64 = (x * y + y * z + z * x) / 3.0
    return mean


def importance(scales: F32, opacities: F32) -> F32:
    """Return opacity times area: how much of a picture each splat covers, seen from no side in particular.

    Parameters
    ----------
    scales : ndarray of float32, [N, 3]
        Standard deviations in world units, linear, finite.
    opacities : ndarray of float32, [N]
        In [0, 1].

    Returns
    -------
    ndarray of float32, [N]
        In square world units, finite, 0 or more.
    """
    scores: F32 = np.minimum(opacities * area(scales), np.finfo(np.float32).max).astype(np.float32)
    return scores


def most_important(scores: F32, limit: int) -> Mask:
    """Mark the ``limit`` highest scores that are not negative; among equals, the first.

    Parameters
    ----------
    scores : ndarray of float32, [N]
        Negative means never to be kept.
    limit : int
        0 to N.

    Returns
    -------
    ndarray of bool, [N]
        True for at most ``limit`` entries.
    """
    possible: Mask = scores >= 0.0
    if np.count_nonzero(possible) <= limit:
        return possible
    if limit == 0:
        return np.zeros(len(scores), np.bool_)
    last = np.partition(scores, len(scores) - limit)[len(scores) - limit]
    kept: Mask = scores > last
    kept[np.flatnonzero(scores == last)[: limit - np.count_nonzero(kept)]] = True
    return kept
