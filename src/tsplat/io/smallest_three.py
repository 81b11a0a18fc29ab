"""Quats of which a file keeps the three smallest components: the largest, not negative, follows from them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

F32 = npt.NDArray[np.float32]
Indices = npt.NDArray[np.intp]

MISSING = 0
"""Place of the largest component in a row of four, before the three others."""


def sources(others: Indices) -> Indices:
    """Return where each component comes from, by which one is the largest.

    Parameters
    ----------
    others : ndarray of intp, [L, 3]
        For each number that a file may give the largest: which components of ``wxyz`` it keeps, in its order.

    Returns
    -------
    ndarray of intp, [L, 4]
        Place of ``wxyz`` in `MISSING` and the three others.
    """
    places = np.full((len(others), 4), MISSING, np.intp)
    np.put_along_axis(places, others, np.arange(1, 4)[None], axis=1)
    return places


BY_COMPONENT = sources(np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]], np.intp))
"""The largest is numbered as in ``wxyz``, and the others follow in that order."""


def fill_quats(smallest: F32, largest: npt.NDArray[np.integer], places: Indices, out: F32) -> None:
    """Make whole quats.

    Parameters
    ----------
    smallest : ndarray of float32, [N, 3]
        Components as the file keeps them.
    largest : ndarray of int, [N]
        Number of the largest one, a row of ``places``.
    places : ndarray of intp, [L, 4]
        As from `sources`.
    out : ndarray of float32, [N, 4]
        Becomes ``wxyz``.
    """
    four = np.empty((len(smallest), 4), np.float32)
    four[:, 1:] = smallest
    four[:, MISSING] = missing(smallest)
    rows = np.arange(0, 4 * len(four), 4)[:, None]
    np.take(four, np.take(places, largest, axis=0) + rows, out=out, mode="clip")


def missing(others: F32) -> F32:
    """Return what is missing to a length of 1, float32 [N], for rows of three components."""
    squares: F32 = np.einsum("ij,ij->i", others, others)
    return np.sqrt(np.maximum(np.float32(0), 1 - squares))
