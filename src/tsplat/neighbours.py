"""How far the nearest neighbours of each splat are, for their sizes.

A search starts in the point's own leaf of a tree and looks into another box only where that is nearer than the
farthest of the neighbours found so far.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tsplat._jit import kernel, part
from tsplat.kd_tree import Tree, kd_tree
from tsplat.processors import available_processors

F32 = npt.NDArray[np.float32]
I64 = npt.NDArray[np.int64]
F64 = npt.NDArray[np.float64]

TINY = 1e-30
"""World units at least that two sizes add up to: splats may have none."""

CHUNK = 1 << 10
"""Leaves searched from at a time, after which progress is said."""

DEPTH = 64
"""Boxes that may wait to be looked into: a tree of all points that an index can count is less deep."""


def mean_gaps(means: F32, sizes: F32, count: int, progress: Callable[[float], None] | None = None) -> F64:
    """Return the mean distance of each splat to its nearest neighbours in units of its and their sizes.

    Parameters
    ----------
    means : ndarray of float32, [N, 3]
        Centres in world units, finite; some may lie at the same place.
    sizes : ndarray of float32, [N]
        In world units, 0 or more.
    count : int
        How many neighbours, itself not among them; all others where there are fewer.
    progress : callable, optional
        Called with the fraction done, growing from 0 to 1.

    Returns
    -------
    ndarray of float64, [N]
        Means of distances between two centres over the sum of their two sizes; 0 for a splat that is alone.
    """
    count = min(count, len(means) - 1)
    if count < 1:
        return np.zeros(len(means))
    tree = kd_tree(means)
    sorted_sizes = sizes[tree.source_from_sorted].astype(np.float64)
    found, gaps = np.empty(len(means)), np.empty(len(means))
    leaves = len(tree.starts) - 1
    pool = ThreadPoolExecutor(available_processors())
    try:
        searches = [
            pool.submit(_search, tree, sorted_sizes, first, min(first + CHUNK, leaves), _room(count), found)
            for first in range(0, leaves, CHUNK)
        ]
        for done, search in enumerate(searches, 1):
            search.result()
            if progress:
                progress(done / len(searches))
    finally:
        pool.shutdown(cancel_futures=True)  # Ctrl-C does not wait for what has not begun
    gaps[tree.source_from_sorted] = found
    return gaps


class _Room(NamedTuple):
    """Memory of one search: the nearest so far and the boxes that wait, and their squared distances."""

    nearest: F64
    where: I64
    waiting: I64
    how_far: F64


def _room(count: int) -> _Room:
    return _Room(np.empty(count), np.empty(count, np.int64), np.empty(DEPTH, np.int64), np.empty(DEPTH))


@kernel
def _search(tree: Tree, sizes: F64, first: int, last: int, room: _Room, out: F64) -> None:
    """Fill ``out`` for the points of the leaves from ``first`` to ``last``."""
    leaves = len(tree.starts) - 1
    nearest, where, waiting, how_far = room.nearest, room.where, room.waiting, room.how_far
    count = len(nearest)
    for leaf in range(first, last):
        for i in range(tree.starts[leaf], tree.starts[leaf + 1]):
            nearest[:] = np.inf
            _look_at(tree, i, leaf, nearest, where)
            box = leaves + leaf
            while box > 1:  # what is beside the box just finished is next, then a box twice as large is finished
                _look_into(tree, i, box ^ 1, nearest, where, waiting, how_far)
                box >>= 1
            total = 0.0
            for k in range(count):
                total += math.sqrt(nearest[k]) / max(sizes[i] + sizes[where[k]], TINY)
            out[i] = total / count


@part
def _look_into(tree: Tree, i: int, box: int, nearest: F64, where: I64, waiting: I64, how_far: F64) -> None:
    """Put what is near enough in a box among the nearest of point ``i``, the nearer half of each box first."""
    leaves = len(tree.starts) - 1
    waiting[0], how_far[0], waits = box, _squared_distance(tree, i, box), 1
    while waits > 0:
        waits -= 1
        box = waiting[waits]
        if not how_far[waits] < nearest[-1]:
            continue
        if box >= leaves:
            _look_at(tree, i, box - leaves, nearest, where)
            continue
        nearer, farther = 2 * box, 2 * box + 1
        near, far = _squared_distance(tree, i, nearer), _squared_distance(tree, i, farther)
        if far < near:
            nearer, farther, near, far = farther, nearer, far, near
        waiting[waits], how_far[waits] = farther, far
        waiting[waits + 1], how_far[waits + 1] = nearer, near
        waits += 2


@part
def _look_at(tree: Tree, i: int, leaf: int, nearest: F64, where: I64) -> None:
    """Put the points of a leaf among the nearest of point ``i``, of which the squared distances are sorted."""
    points = tree.points
    for j in range(tree.starts[leaf], tree.starts[leaf + 1]):
        x, y, z = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
        squared = x * x + y * y + z * z
        place = len(nearest) - 1
        if j == i or not squared < nearest[place]:
            continue
        while place > 0 and nearest[place - 1] > squared:
            nearest[place], where[place] = nearest[place - 1], where[place - 1]
            place -= 1
        nearest[place], where[place] = squared, j


@part
def _squared_distance(tree: Tree, i: int, box: int) -> float:
    """Return how far a box is from point ``i``, squared: 0 inside of it."""
    squared = 0.0
    for axis in range(3):
        at = tree.points[i, axis]
        beyond = max(tree.boxes[box, axis] - at, at - tree.boxes[box, 3 + axis], 0.0)
        squared += beyond * beyond
    return squared
