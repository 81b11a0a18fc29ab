"""Codebooks of a SOG scene: 256 numbers that stand for all of a kind.

Source: Equitz 1989, *A New Vector Quantization Clustering Algorithm*: neighbours become one until few are left.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tsplat.io.sog_meta import LEVELS

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
U8 = npt.NDArray[np.uint8]

SHARE = 4
"""One in so many of those that have to go does so at a time, so that the last ones go one by one."""


def fit_codebook(values: F32, weights: F32 | None = None) -> F32:
    """Return levels from which values are apart nearly as little as may be, in the mean of squares.

    Parameters
    ----------
    values : ndarray of float32, any shape
        Finite.
    weights : ndarray of float32, optional
        How much each value matters, above 0; by default all alike.

    Returns
    -------
    ndarray of float32, [256]
        Ascending; where there are no more different values than levels, these values, the last one repeated; zeros
        of no values.
    """
    if not values.size:
        return np.zeros(LEVELS, np.float32)
    order = np.argsort(values, axis=None)
    ordered = values.ravel()[order].astype(np.float64)
    masses = np.ones(len(ordered)) if weights is None else weights.ravel()[order].astype(np.float64)
    starts = np.flatnonzero(np.diff(ordered, prepend=-np.inf))
    levels, masses = ordered[starts], np.add.reduceat(masses, starts)
    while len(levels) > LEVELS:
        starts = np.flatnonzero(~np.concatenate(([False], _to_merge(levels, masses))))
        moments = np.add.reduceat(levels * masses, starts)
        masses = np.add.reduceat(masses, starts)
        levels = moments / masses
    return np.pad(levels, (0, LEVELS - len(levels)), mode="edge").astype(np.float32)


def nearest_levels(values: F32, codebook: F32) -> U8:
    """Return the number of the level that is nearest to each value, in the shape of the values."""
    levels = codebook.astype(np.float64)
    return np.searchsorted((levels[1:] + levels[:-1]) / 2, values).astype(np.uint8)


def _to_merge(levels: F64, masses: F64) -> npt.NDArray[np.bool_]:
    # Which levels become one with the next: where least is lost, and of pairs that share a level one in two.
    losses = masses[:-1] * masses[1:] / (masses[:-1] + masses[1:]) * np.diff(levels) ** 2
    last = (len(levels) - LEVELS) // SHARE
    chosen = np.zeros(len(losses) + 2, np.bool_)
    chosen[1 + np.argpartition(losses, last)[: last + 1]] = True
    merging = chosen[1:-1] & ~(chosen[:-2] | chosen[2:])
    merging[::2] = chosen[1:-1:2]
    return merging
