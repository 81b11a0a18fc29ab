"""Words for kernels that move eight float32 lanes in other ways than `_lanes.load` and `_lanes.store` do.

As in `_lanes`, each is plain Python for Python, and a few instructions in a kernel.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tsplat._lanes import LANES


def store_past_caches(array: Any, offset: Any, value: Any) -> None:
    """Put eight values into an array that starts a cache line, from a multiple of eight on, past the caches."""
    array[offset : offset + LANES] = value


def load_half(array: Any, offset: Any) -> Any:
    """The eight half-precision values of a flat uint16 array that start at ``offset``."""
    return array[offset : offset + LANES].view(np.float16).astype(np.float32)


def store_half(array: Any, offset: Any, value: Any) -> None:
    """Put eight values into a flat uint16 array from ``offset`` on, as half-precision numbers."""
    array[offset : offset + LANES] = value.astype(np.float16).view(np.uint16)


def store_paired_halves(array: Any, offset: Any, low: Any, high: Any) -> None:
    """Put two half-precision numbers into each of eight float32 of a flat array, ``low`` in the low bits."""
    low, high = (each.astype(np.float16).view(np.uint16).astype(np.uint32) for each in (low, high))
    array[offset : offset + LANES] = (low | high << np.uint32(16)).view(np.float32)


def first_halves(one: Any, other: Any) -> Any:
    """The first four lanes of one vector, then those of another."""
    return np.concatenate([one[:4], other[:4]])


def second_halves(one: Any, other: Any) -> Any:
    """The last four lanes of one vector, then those of another."""
    return np.concatenate([one[4:], other[4:]])


def interleaved(red: Any, green: Any, blue: Any) -> tuple[Any, Any, Any]:
    """Three vectors that hold the red, green and blue of one lane after the other."""
    first, second, third = np.stack([red, green, blue], 1).reshape(3, LANES)
    return first, second, third


def store_transposed(target: Any, at: Any, stride: Any, source: Any, start: Any, distance: Any) -> None:
    """Copy eight vectors, ``distance`` apart, as the columns of eight rows of eight values, ``stride`` apart."""
    for lane in range(LANES):
        for column in range(LANES):
            target[at + lane * stride + column] = source[start + column * distance + lane]


def prefetch(array: Any, offset: Any) -> None:
    """Ask the processor to bring the cache line of ``array[offset]`` closer; changes no value."""
