"""Stage 2: visible splats by depth, nearest first; equal depths keep the order of the file.

A radix sort of two passes, 9 low bits and 15 high ones, of 8-byte pairs (key, record): stable, and
for positive depths complete. Of the high ones a frame uses few: 128 for each time that depths double. Each worker
counts and scatters a stretch of its own.
"""

from __future__ import annotations

import numpy as np

from tsplat._jit import part
from tsplat._threads import meet
from tsplat.raster.frame import BUCKETS, HIGHEST_KEY, LOW_BITS, LOWEST_KEY, VISIBLE
from tsplat.raster.prepare import BLOCK

LOW_BUCKETS = 1 << LOW_BITS


@part
def sort(worker, frame):
    """Fill ``order``, the records by depth."""
    counts, cursors = frame.sort_counts[worker], frame.sort_cursors[worker]
    first, end = _blocks_of(worker, frame.workers, frame.visible)
    _count_low(first, end, frame.depth_keys, frame.visible, counts)
    if not meet(frame.team, frame.workers):
        return False
    total = scan(worker, frame.sort_counts, 0, LOW_BUCKETS, cursors)
    frame.results[worker, VISIBLE] = total
    _scatter_low(first, end, frame.depth_keys, frame.visible, cursors, frame.pairs)
    if not meet(frame.team, frame.workers):
        return False
    first, end = stretch(worker, frame.workers, total)
    frame.results[worker, LOWEST_KEY], frame.results[worker, HIGHEST_KEY] = _count_high(
        first, end, frame.pairs, counts
    )
    if not meet(frame.team, frame.workers):
        return False
    # Depths of a frame share few of the buckets, and what another worker counted is far away: look at no others.
    lowest, highest = frame.results[0, LOWEST_KEY], frame.results[0, HIGHEST_KEY]
    for other in range(1, frame.workers):
        lowest, highest = (
            min(lowest, frame.results[other, LOWEST_KEY]),
            max(highest, frame.results[other, HIGHEST_KEY]),
        )
    scan(worker, frame.sort_counts, lowest, highest + 1, cursors)
    _scatter_high(first, end, frame.pairs, cursors, frame.order)
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
def _count_low(first, end, depth_keys, visible, counts):
    counts[:LOW_BUCKETS] = 0
    for block in range(first, end):
        for record in range(block * BLOCK, block * BLOCK + visible[block]):
            counts[np.uint64(depth_keys[np.uint64(record)] & np.uint32(LOW_BUCKETS - 1))] += 1


@part
def _scatter_low(first, end, depth_keys, visible, cursors, pairs):
    for block in range(first, end):
        for record in range(block * BLOCK, block * BLOCK + visible[block]):
            key = np.uint64(depth_keys[np.uint64(record)])
            bucket = key & np.uint64(LOW_BUCKETS - 1)
            pairs[np.uint64(cursors[bucket])] = (key >> np.uint64(LOW_BITS)) << np.uint64(32) | np.uint64(record)
            cursors[bucket] += 1


@part
def _count_high(first, end, pairs, counts):
    """Count keys by their high bits; return the lowest and the highest of these."""
    counts[:] = 0
    lowest, highest = np.uint64(BUCKETS - 1), np.uint64(0)
    for i in range(first, end):
        bucket = pairs[np.uint64(i)] >> np.uint64(32)
        lowest, highest = min(lowest, bucket), max(highest, bucket)
        counts[bucket] += 1
    return np.int64(lowest), np.int64(highest)


@part
def _scatter_high(first, end, pairs, cursors, order):
    for i in range(first, end):
        bucket = pairs[np.uint64(i)] >> np.uint64(32)
        order[np.uint64(cursors[bucket])] = pairs[np.uint64(i)] & np.uint64(0xFFFFFFFF)
        cursors[bucket] += 1
