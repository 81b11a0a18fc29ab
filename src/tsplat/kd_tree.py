"""Points halved, and halved again, across where they are widest: what is near in space comes to lie together.

Source: Friedman, Bentley and Finkel 1977, *An Algorithm for Finding Best Matches in Logarithmic Expected Time*.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tsplat._jit import kernel, part

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

LEAF = 16
"""Points that are not halved again: looking at so many is about as quick as asking whether to."""


class Tree(NamedTuple):
    """Points and the boxes around them.

    Box 1 is around all points, boxes 2 i and 2 i + 1 are the halves of box i, the last L boxes are the leaves.

    Attributes
    ----------
    points : ndarray of float64, [N, 3]
        Leaf by leaf.
    source_from_sorted : ndarray of int64, [N]
        Where each of them came from.
    starts : ndarray of int64, [L + 1]
        Where the points of each leaf start, and N; L is a power of two.
    boxes : ndarray of float64, [2 * L, 6]
        Lowest corner and highest corner; box 0 is not used.
    """

    points: F64
    source_from_sorted: I64
    starts: I64
    boxes: F64


def kd_tree(means: F32) -> Tree:
    """Return the tree of some points.

    Parameters
    ----------
    means : ndarray of float32, [N, 3]
        At least one, finite; some may lie at the same place.
    """
    n = len(means)
    levels = max(0, (n - 1) // LEAF).bit_length()
    points = means.astype(np.float64)  # the square of a float32 need not be one
    source_from_sorted = np.arange(n)
    _halve(points, source_from_sorted, levels)
    starts = np.arange((1 << levels) + 1) * n >> levels
    return Tree(points, source_from_sorted, starts, _boxes(points, starts))


def _boxes(points: F64, starts: I64) -> F64:
    leaves = len(starts) - 1
    boxes = np.zeros((2 * leaves, 6))
    boxes[leaves:, :3] = np.minimum.reduceat(points, starts[:-1])
    boxes[leaves:, 3:] = np.maximum.reduceat(points, starts[:-1])
    while leaves > 1:
        halves = boxes[leaves : 2 * leaves].reshape(-1, 2, 6)
        leaves //= 2
        boxes[leaves : 2 * leaves, :3] = halves[:, :, :3].min(axis=1)
        boxes[leaves : 2 * leaves, 3:] = halves[:, :, 3:].max(axis=1)
    return boxes


@kernel
def _halve(points: F64, source_from_sorted: I64, levels: int) -> None:
    n = len(points)
    for level in range(levels):
        for node in range(1 << level):
            first, last, middle = node * n >> level, (node + 1) * n >> level, (2 * node + 1) * n >> level + 1
            _select(points, source_from_sorted, first, last, middle, _widest(points, first, last))


@part
def _widest(points: F64, first: int, last: int) -> int:
    """Return the axis along which these points are farthest apart."""
    widest, width = 0, -1.0
    for axis in range(3):
        low = high = points[first, axis]
        for i in range(first, last):
            low, high = min(low, points[i, axis]), max(high, points[i, axis])
        if high - low > width:
            widest, width = axis, high - low
    return widest


@part
def _select(points: F64, source_from_sorted: I64, first: int, last: int, middle: int, axis: int) -> None:
    """Swap points until none before ``middle`` is beyond those after it (Hoare 1961, *Algorithm 65: FIND*)."""
    left, right = first, last - 1
    while left < right:
        pivot = points[middle, axis]
        i, j = left, right
        while i <= j:
            while points[i, axis] < pivot:
                i += 1
            while points[j, axis] > pivot:
                j -= 1
            if i <= j:
                for column in range(3):
                    points[i, column], points[j, column] = points[j, column], points[i, column]
                source_from_sorted[i], source_from_sorted[j] = source_from_sorted[j], source_from_sorted[i]
                i, j = i + 1, j - 1
        if j < middle:
            left = i
        if i > middle:
            right = j
