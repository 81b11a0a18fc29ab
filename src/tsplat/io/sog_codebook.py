"""Codebooks of a SOG scene: 256 numbers that stand for all of a kind.

Source: Equitz 1989, *A New Vector Quantization Clustering Algorithm*, which merges neighbours until few are left;
Lloyd 1982, *Least Squares Quantization in PCM*, for the rest.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tsplat.io.sog_meta import LEVELS

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
U8 = npt.NDArray[np.uint8]

ROUNDS = 10
"""More of them change errors by less than a hundredth."""

SHARE = 4
"""One in so many of those to go is merged at a time, so that the last ones go one by one."""


def fit_codebook(values: F32, weights: F32 | None = None) -> F32:
    """Return levels from which values are apart as little as may be, in the mean of squares.

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
    moments = ordered * masses
    levels = _merged(ordered, masses)
    for _ in range(ROUNDS):
        # The last value is the last level's, whatever rounding says.
        starts = np.concatenate(([0], np.searchsorted(ordered[:-1], _edges(levels))))
        levels = np.add.reduceat(moments, starts) / np.add.reduceat(masses, starts)
    return np.pad(levels, (0, LEVELS - len(levels)), mode="edge").astype(np.float32)


def nearest_levels(values: F32, codebook: F32) -> U8:
    """Return the number of the level that is nearest to each value, in the shape of the values."""
    return np.searchsorted(_edges(codebook.astype(np.float64)), values).astype(np.uint8)


def _edges(levels: F64) -> F64:
    edges: F64 = (levels[1:] + levels[:-1]) / 2
    return edges


def _merged(ordered: F64, masses: F64) -> F64:
    # The means of 256 runs of values, or of fewer. Neighbours that lose least by it become one first.
    starts = np.flatnonzero(np.diff(ordered, prepend=-np.inf))
    means, masses = ordered[starts], np.add.reduceat(masses, starts)
    while (surplus := len(means) - LEVELS) > 0:
        losses = masses[:-1] * masses[1:] / (masses[:-1] + masses[1:]) * np.diff(means) ** 2
        chosen = np.zeros(len(losses) + 2, np.bool_)
        chosen[1 + np.argpartition(losses, surplus // SHARE)[: surplus // SHARE + 1]] = True
        # Of pairs that share a value, one in two.
        apart = chosen[1:-1] & ~(chosen[:-2] | chosen[2:])
        apart[::2] = chosen[1:-1:2]
        starts = np.flatnonzero(np.concatenate(([True], ~apart)))
        moments = np.add.reduceat(means * masses, starts)
        masses = np.add.reduceat(masses, starts)
        means = moments / masses
    return means
