"""The palette of a SOG scene: as many colours beyond degree 0 as labels can name, for all splats.

Clusters within clusters: 256 coarse ones by k-means, each divided again by k-means into its share of the palette.
One k-means over all would compare every splat with every entry, a hundred times the work.

Source: Lloyd 1982, *Least Squares Quantization in PCM*; Gersho 1979, *Asymptotically Optimal Block Quantization*,
for shares that follow the errors.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]

COARSE = 256
"""Coarse clusters: about the root of the largest palette, where the work is least."""

SAMPLES = 64
"""So many points for each coarse cluster tell where it lies."""

ROUNDS = 5
"""Twice as many take twice the time and lower the errors by half a hundredth."""

BLOCK = 1 << 18
"""Products for one multiplication of matrices: more are shared out among threads, which on a busy machine takes
ten times as long as it saves, and do not stay in the cache."""

SEED = 5
"""Of the choice which points clusters begin with: the same scene makes the same file."""


def fit_palette(points: F32, weights: F32, size: int) -> tuple[F32, Indices]:
    """Choose entries that stand for all points, apart from them as little as may be in the mean of squares.

    Parameters
    ----------
    points : ndarray of float32, [N, D]
        N at least 1; so small that squares do not overflow.
    weights : ndarray of float32, [N]
        How much each matters, above 0.
    size : int
        How many entries there may be, at least twice `COARSE`.

    Returns
    -------
    palette : ndarray of float32, [n, D]
        At most ``size`` entries; the points themselves where no more of them differ.
    labels : ndarray of intp, [N]
        Which entry stands for each point.
    """
    distinct, distinct_from_point = _distinct(points)
    if len(distinct) <= size:
        return distinct, distinct_from_point
    weights = np.bincount(distinct_from_point, weights).astype(np.float32)
    rng = np.random.default_rng(SEED)
    sample = rng.choice(len(distinct), min(len(distinct), COARSE * SAMPLES), replace=False)
    centres = _k_means(distinct[sample], weights[sample], COARSE, rng)
    coarse = _nearest(distinct, centres)
    # A little more than nothing, where points are nearer than squares can tell.
    errors = weights * np.square(distinct - centres[coarse]).sum(axis=1) + np.finfo(np.float32).tiny
    counts = np.bincount(coarse, minlength=COARSE)
    shares = _shares(np.bincount(coarse, errors, COARSE).astype(np.float64), counts, size)
    palette = np.empty((shares.sum(), points.shape[1]), np.float32)
    labels = np.empty(len(distinct), np.intp)
    members = np.split(np.argsort(coarse, kind="stable"), np.cumsum(counts)[:-1])
    for rows, share, end in zip(members, shares, np.cumsum(shares), strict=True):
        if not share:
            continue
        entries = _k_means(distinct[rows], weights[rows], share, rng)
        palette[end - share : end] = entries
        labels[rows] = end - share + _nearest(distinct[rows], entries)
    return palette, labels[distinct_from_point]


def _distinct(points: F32) -> tuple[F32, Indices]:
    # Rows as single values are compared as bytes, which is fast.
    rows = np.ascontiguousarray(points).view(np.dtype((np.void, points.itemsize * points.shape[1]))).ravel()
    distinct, distinct_from_point = np.unique(rows, return_inverse=True)
    return distinct.view(np.float32).reshape(-1, points.shape[1]), distinct_from_point


def _shares(errors: F64, counts: Indices, size: int) -> Indices:
    # Entries for each cluster: in proportion to its errors, one at least where it has members, and none to spare.
    filled = counts > 0
    room = np.maximum(counts - 1, 0)
    wanted = errors * ((size - COARSE) / errors.sum())
    for _ in range(ROUNDS):
        wanted *= (size - COARSE) / np.minimum(wanted, room).sum()
    whole = np.diff(np.floor(np.cumsum(np.minimum(wanted, room))), prepend=0.0)
    shares: Indices = filled + np.minimum(whole, room).astype(np.intp)
    return shares


def _k_means(points: F32, weights: F32, k: int, rng: np.random.Generator) -> F32:
    centres = points[rng.choice(len(points), k, replace=False)]
    if k < len(points):
        for _ in range(ROUNDS):
            _move(centres, points, weights, _nearest(points, centres))
    return centres


def _nearest(points: F32, centres: F32) -> Indices:
    # The nearest is the most similar: of a squared distance, what the centres do not share.
    halves = 0.5 * np.square(centres).sum(axis=1)
    labels = np.empty(len(points), np.intp)
    rows = max(1, BLOCK // centres.size)
    for first in range(0, len(points), rows):
        similarities = points[first : first + rows] @ centres.T
        similarities -= halves
        similarities.argmax(axis=1, out=labels[first : first + rows])
    return labels


def _move(centres: F32, points: F32, weights: F32, labels: Indices) -> None:
    # Each centre to the mean of its points; one without any stays.
    order = np.argsort(labels, kind="stable")
    ordered = labels[order]
    starts = np.flatnonzero(np.diff(ordered, prepend=-1))
    sums = np.add.reduceat(points[order] * weights[order, None], starts, axis=0)
    centres[ordered[starts]] = sums / np.add.reduceat(weights[order], starts)[:, None]
