"""Memory that frames share: it grows with the largest frame, never shrinks, and is never copied."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

F32 = npt.NDArray[np.float32]

CACHE_LINE = 64
"""Bytes. A record or a vector that straddles two lines costs twice as much to load."""

SPARE = CACHE_LINE // 4
"""Values that an image's memory is longer than the image."""

MOST_AHEAD = 32 << 20
"""Bytes that an array grows by at most beyond what is asked for, as what grew once may grow again."""

IMAGES_KEPT = 8
"""Two frames of colours, alphas and depths are in use at once; more would only be forgotten memory."""


def aligned(
    length: int, dtype: npt.DTypeLike, memory_of: Callable[..., npt.NDArray[Any]] = np.empty
) -> npt.NDArray[Any]:
    """Return a new array whose first element starts a cache line; ``np.zeros`` for one of zeros."""
    size = length * np.dtype(dtype).itemsize
    memory = memory_of(size + CACHE_LINE, np.uint8)
    start = -memory.ctypes.data % CACHE_LINE
    return memory[start : start + size].view(dtype)


class Buffers:
    """Work arrays by name, and images that are used again once their last user has dropped them."""

    def __init__(self) -> None:
        self._arrays: dict[str, npt.NDArray[Any]] = {}
        self._images: list[F32] = []
        self._starts: list[int] = []

    def array(self, name: str, length: int, dtype: npt.DTypeLike) -> npt.NDArray[Any]:
        """Return the array of that name, at least this long; what it held is lost when it grows."""
        found = self._arrays.get(name)
        if found is not None and len(found) >= length:
            return found
        ahead = 0 if found is None else min(length // 2, MOST_AHEAD // np.dtype(dtype).itemsize)
        found = None
        self._arrays.pop(name, None)  # the old one goes before the new one comes
        self._arrays[name] = aligned(length + ahead, dtype)
        return self._arrays[name]

    @property
    def nbytes(self) -> int:
        """How many bytes the work arrays take."""
        return sum(array.nbytes for array in self._arrays.values())

    def image(self, *shape: int) -> F32:
        """Return an image of unspecified content that nobody else holds; its first value starts a cache line."""
        size = math.prod(shape)
        for place in range(len(self._images)):
            # The list and the question itself hold an image that is free; every view of it holds it once more.
            if sys.getrefcount(self._images[place]) == 2:
                if len(self._images[place]) < size + SPARE:
                    self._images[place], self._starts[place] = _memory(size)
                return self._images[place][self._starts[place] :][:size].reshape(shape)
        memory, start = _memory(size)
        if len(self._images) < IMAGES_KEPT:
            self._images.append(memory)
            self._starts.append(start)
        return memory[start:][:size].reshape(shape)


def _memory(size: int) -> tuple[F32, int]:
    """Return memory for so many values from one on that starts a cache line, and which that is."""
    memory = np.empty(size + SPARE, np.float32)
    return memory, -memory.ctypes.data % CACHE_LINE // memory.itemsize
