"""A queue of blocks, the one with the largest number first: a heap of keys."""

from __future__ import annotations

import numpy as np

from tsplat._jit import part

LOW_WORD = np.uint64(0xFFFFFFFF)


@part
def key_of(number, block):
    """Return a number as the high bits of a key, and the block.

    Numbers are not negative, so their bits are in the same order as they are.
    """
    return np.uint64(np.float32(number).view(np.uint32)) << np.uint64(32) | np.uint64(block)


@part
def block_of(key):
    """Return the block of a key."""
    return np.int64(key & LOW_WORD)


@part
def push(queue, waiting, key):
    """Add a key to so many that wait; return how many do then."""
    at = waiting
    while at > 0 and queue[(at - 1) >> 1] < key:
        queue[at] = queue[(at - 1) >> 1]
        at = (at - 1) >> 1
    queue[at] = key
    return waiting + 1


@part
def drop_first(queue, waiting):
    """Take the largest key out of so many that wait; return how many are left."""
    left = waiting - 1
    key, at = queue[left], 0
    while 2 * at + 1 < left:
        child = 2 * at + 1
        if child + 1 < left and queue[child + 1] > queue[child]:
            child += 1
        if queue[child] <= key:
            break
        queue[at] = queue[child]
        at = child
    queue[at] = key
    return left
