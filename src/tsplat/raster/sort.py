"""Stage 2: visible splats by depth, nearest first; equal depths keep the order of the file.

A radix sort of three passes, 9, 9 and 14 bits, of 8-byte pairs (key, record): stable, and complete, as the bits
of positive numbers are in the order of the numbers. Of the high bits a frame uses few values: 256 for each time
that depths double. Each worker counts and scatters a stretch of its own.
"""

from __future__ import annotations

import numpy as np

from tsplat._jit import part
from tsplat._threads import meet
from tsplat.raster.frame import HIGH_BUCKETS, HIGHEST, LOWEST, SORT_BITS, VISIBLE
from tsplat.raster.prepare import BLOCK

BUCKETS = 1 << SORT_BITS

RECORD = 32
"""Bits of a pair below its key."""


@part
def sort(worker, frame):
    """Fill ``order``, the records by depth."""
    counts, cursors = frame.sort_counts[worker], frame.sort_cursors[worker]
    half_sorted = frame.sorted_tiles  # which nobody needs yet
    first, end = _blocks_of(worker, frame.workers, frame.visible)
    _count_keys(first, end, frame.depth_keys, frame.visible, counts)
    if not meet(frame.team, frame.workers):
        return False
    total = scan(worker, frame.sort_counts, 0, BUCKETS, cursors)
    frame.results[worker, VISIBLE] = total
    _scatter_keys(first, end, frame.depth_keys, frame.visible, cursors, frame.pairs)
    if not meet(frame.team, frame.workers):
        return False
    first, end = stretch(worker, frame.workers, total)
    _count_middle(first, end, frame.pairs, counts)
    if not meet(frame.team, frame.workers):
        return False
    scan(worker, frame.sort_counts, 0, BUCKETS, cursors)
    _scatter_middle(first, end, frame.pairs, cursors, half_sorted)
    if not meet(frame.team, frame.workers):
        return False
    frame.results[worker, LOWEST], frame.results[worker, HIGHEST] = _count_high(first, end, half_sorted, counts)
    if not meet(frame.team, frame.workers):
        return False
    # Depths of a frame share few of the buckets, and what another worker counted is far away: look at no others.
    lowest, highest = frame.results[0, LOWEST], frame.results[0, HIGHEST]
    for other in range(1, frame.workers):
        lowest = min(lowest, frame.results[other, LOWEST])
        highest = max(highest, frame.results[other, HIGHEST])
    scan(worker, frame.sort_counts, lowest, highest + 1, cursors)
    _scatter_high(first, end, half_sorted, cursors, frame.order)
    return meet(frame.team, frame.workers)


@part
def stretch(worker, workers, total):
    """Return where a worker's part of ``total`` things starts and ends."""
    return total * worker // workers, total * (worker + 1) // workers


@part
def _blocks_of(worker, workers, visible):
    """Return a worker's first block and the one after its last, so that all have about as many records."""
    total = 0
    for block in range(len(visible)):
        total += visible[block]
    low, high = stretch(worker, workers, total)
    first, end, done = len(visible), len(visible), 0
    for block in range(len(visible)):
        if done >= low:
            first = min(first, block)
        if done >= high:
            end = min(end, block)
        done += visible[block]
    return (first, end) if worker > 0 else (0, end)


@part
def scan(worker, counts, first, end, cursors):
    """Write where this worker's part of each bucket starts, after the parts of those before it; return the sum."""
    total = 0
    for bucket in range(first, end):
        for other in range(counts.shape[0]):
            if other == worker:
                cursors[np.uint64(bucket)] = total
            total += counts[np.uint64(other), np.uint64(bucket)]
    return total


@part
def _low(key):
    return np.uint64(key) & np.uint64(BUCKETS - 1)


@part
def _middle(pair):
    return pair >> np.uint64(RECORD + SORT_BITS) & np.uint64(BUCKETS - 1)


@part
def _high(pair):
    return pair >> np.uint64(RECORD + 2 * SORT_BITS)


@part
def _count_keys(first, end, depth_keys, visible, counts):
    counts[:BUCKETS] = 0
    for block in range(first, end):
        for record in range(block * BLOCK, block * BLOCK + visible[block]):
            counts[_low(depth_keys[np.uint64(record)])] += 1


@part
def _scatter_keys(first, end, depth_keys, visible, cursors, pairs):
    for block in range(first, end):
        for record in range(block * BLOCK, block * BLOCK + visible[block]):
            key = depth_keys[np.uint64(record)]
            bucket = _low(key)
            pairs[np.uint64(cursors[bucket])] = np.uint64(key) << np.uint64(RECORD) | np.uint64(record)
            cursors[bucket] += 1


@part
def _count_middle(first, end, pairs, counts):
    counts[:BUCKETS] = 0
    for i in range(first, end):
        counts[_middle(pairs[np.uint64(i)])] += 1


@part
def _scatter_middle(first, end, pairs, cursors, half_sorted):
    for i in range(first, end):
        pair = pairs[np.uint64(i)]
        bucket = _middle(pair)
        half_sorted[np.uint64(cursors[bucket])] = pair
        cursors[bucket] += 1


@part
def _count_high(first, end, half_sorted, counts):
    """Count depths by their high bits; return the lowest and the highest of these."""
    counts[:] = 0
    lowest, highest = np.uint64(HIGH_BUCKETS - 1), np.uint64(0)
    for i in range(first, end):
        bucket = _high(half_sorted[np.uint64(i)])
        lowest, highest = min(lowest, bucket), max(highest, bucket)
        counts[bucket] += 1
    return np.int64(lowest), np.int64(highest)


@part
def _scatter_high(first, end, half_sorted, cursors, order):
    for i in range(first, end):
        pair = half_sorted[np.uint64(i)]
        bucket = _high(pair)
        order[np.uint64(cursors[bucket])] = pair & np.uint64(0xFFFFFFFF)
        cursors[bucket] += 1
