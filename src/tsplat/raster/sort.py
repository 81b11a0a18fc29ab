"""Stage 4a: the splats of one tile by depth, in buckets that are finished only when they are drawn.

A tile's keys fit the cache, tiles are independent, and a tile that is full before its last bucket
never sorts the rest. Keys are unique (depth, then record), so their order does not depend on threads.
"""

from __future__ import annotations

import numpy as np

from tsplat._jit import kernel

MAX_BUCKETS = 2048
"""Enough for about two splats a bucket in most tiles; the counters stay in the first-level cache."""

SHELL_GAPS = (57, 10, 1)
"""Every other gap of Ciura 2001; buckets are small, so mostly the last is used, which is insertion sort."""


@kernel
def into_buckets(isect_keys, first, end, sorted_keys, bucket_ends):
    """Scatter the keys ``first`` to ``end`` into depth buckets; return how many buckets there are.

    ``sorted_keys`` receives them from 0 on; bucket b ends at ``bucket_ends[b]``. Keys are below
    2**63, as those of positive depths are.
    """
    low = high = isect_keys[np.uint64(first)]
    for i in range(first, end):
        key = isect_keys[np.uint64(i)]
        low, high = min(low, key), max(high, key)
    wanted = min(max((end - first) >> 1, 1), MAX_BUCKETS)
    shift = np.uint64(0)
    span = high - low
    while (span >> shift) >= np.uint64(wanted):
        shift += np.uint64(1)
    buckets = np.int64(span >> shift) + 1
    for bucket in range(buckets + 1):
        bucket_ends[bucket] = 0
    for i in range(first, end):
        bucket_ends[((isect_keys[np.uint64(i)] - low) >> shift) + np.uint64(1)] += 1
    for bucket in range(1, buckets):
        bucket_ends[bucket] += bucket_ends[bucket - 1]
    # Each bucket's start moves to its end while it fills.
    for i in range(first, end):
        key = isect_keys[np.uint64(i)]
        bucket = (key - low) >> shift
        at = bucket_ends[bucket]
        sorted_keys[np.uint64(at)] = key
        bucket_ends[bucket] = at + 1
    return buckets


@kernel
def sort_bucket(keys, first, end):
    """Sort ``keys[first:end]`` in place."""
    for gap in SHELL_GAPS:
        for i in range(first + gap, end):
            key = keys[np.uint64(i)]
            j = i
            while j >= first + gap and keys[np.uint64(j - gap)] > key:
                keys[np.uint64(j)] = keys[np.uint64(j - gap)]
                j -= gap
            keys[np.uint64(j)] = key
