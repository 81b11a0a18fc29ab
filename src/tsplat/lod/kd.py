"""An order of splats in which every block of them, and every two, four, eight blocks side by side, lie together.

Source: Bentley 1975, *Multidimensional binary search trees*; cuts here fall between whole blocks.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tsplat._jit import kernel, part
from tsplat._threads import FIRST_FREE, claim, new_team
from tsplat.raster.prepare import BLOCK
from tsplat.raster.workers import on_threads

F32 = npt.NDArray[np.float32]
Order = npt.NDArray[np.int32]

PARTS_A_THREAD = 8
"""Ranges that are cut before the threads share them out: enough for all to end at about the same time."""

DEEPEST = 64
"""More cuts than any number of splats needs one below the other."""


def kd_order(means: F32, threads: int) -> Order:
    """Return indices into ``means``: blocks ``2^k j`` to ``2^k (j + 1)`` are a cell of space for every k and j.

    Parameters
    ----------
    means : ndarray of float32, [N, 3]
        Centres, finite.
    threads : int
        How many work at it.

    Returns
    -------
    ndarray of int32, [N]
        Every index once.
    """
    axes = np.ascontiguousarray(means.T)
    order = np.arange(len(means), dtype=np.int32)
    ranges = np.empty((threads, DEEPEST, 2), np.int64)
    parts = max(1, PARTS_A_THREAD * threads)
    ends = np.zeros(max(1, -(-len(means) // BLOCK)) + 1, np.int64)
    ends = ends[: _cut_coarsely(axes, order, parts, ranges[0], ends)]
    team = new_team(1)
    on_threads(threads, team, _cut_parts.on(_Job(team, ranges, axes, order, ends)))
    return order


class _Job(NamedTuple):
    """What `_cut_parts` shares: ``ends`` are where the parts begin, and where the last one ends.

    ``ranges`` are those that each worker has still to cut.
    """

    team: npt.NDArray[np.int64]
    ranges: npt.NDArray[np.int64]
    axes: F32
    order: Order
    ends: npt.NDArray[np.int64]


@kernel
def _cut_coarsely(axes, order, parts, ranges, ends):
    """Cut all until there are about so many parts; fill ``ends`` as far as the returned number."""
    n = len(order)
    wanted = max(BLOCK, n // parts)
    count = 1
    ranges[0, 0], ranges[0, 1] = 0, n
    left = 1
    while left > 0:
        left -= 1
        low, high = ranges[left, 0], ranges[left, 1]
        if high - low <= wanted:
            ends[count] = high
            count += 1
            continue
        middle = _cut(axes, order, low, high)
        ranges[left, 0], ranges[left, 1] = middle, high
        ranges[left + 1, 0], ranges[left + 1, 1] = low, middle
        left += 2
    return count


@kernel
def _cut_parts(worker, job):
    """Cut each part down to blocks."""
    ranges = job.ranges[worker]
    while True:
        piece = claim(job.team, FIRST_FREE)
        if piece >= len(job.ends) - 1:
            return
        ranges[0, 0], ranges[0, 1] = job.ends[piece], job.ends[piece + 1]
        left = 1
        while left > 0:
            left -= 1
            low, high = ranges[left, 0], ranges[left, 1]
            if high - low > BLOCK:
                middle = _cut(job.axes, job.order, low, high)
                ranges[left, 0], ranges[left, 1] = middle, high
                ranges[left + 1, 0], ranges[left + 1, 1] = low, middle
                left += 2


@part
def _cut(axes, order, low, high):
    """Part a range across its longest side, the largest power of two of blocks to the left; return where."""
    axis, longest = 0, np.float32(-1.0)
    for each in range(3):
        least = most = axes[each, order[low]]
        for i in range(low + 1, high):
            value = axes[each, order[i]]
            least, most = min(least, value), max(most, value)
        if most - least > longest:
            axis, longest = each, most - least
    blocks, left = (high - low + BLOCK - 1) // BLOCK, 1
    while 2 * left < blocks:
        left *= 2
    middle = low + left * BLOCK
    _select(axes, axis, order, low, high, middle)
    return middle


@part
def _select(axes, axis, order, low, high, middle):
    """Move what is least along an axis before ``middle``; Hoare 1961, *Algorithm 65: FIND*."""
    while high - low > 1:
        pivot = axes[axis, order[(low + high) // 2]]
        i, j = low, high - 1
        while i <= j:
            while axes[axis, order[i]] < pivot:
                i += 1
            while axes[axis, order[j]] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            high = j + 1
        elif middle >= i:
            low = i
        else:
            return
