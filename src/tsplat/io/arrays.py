"""The arrays that a reader fills, allocated once, and the chunks in which it fills them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, Self

import numpy as np
import numpy.typing as npt

F32 = npt.NDArray[np.float32]

CHUNK = 4096
"""Splats decoded at a time: with what they are decoded from they fit a core's cache."""


class Arrays(NamedTuple):
    """The arrays of `Gaussians`, not yet checked, or some rows of them.

    Attributes
    ----------
    means, scales : ndarray of float32, [N, 3]
        As in `Gaussians`.
    quats : ndarray of float32, [N, 4]
        ``wxyz``, of any length above zero.
    opacities : ndarray of float32, [N]
        From 0 to 1.
    sh : ndarray of float32, [N, K, 3]
        As in `Gaussians`.
    """

    means: F32
    quats: F32
    scales: F32
    opacities: F32
    sh: F32

    @classmethod
    def empty(cls, count: int, k: int) -> Self:
        """Return arrays for so many splats with so many coefficients, holding anything."""
        shapes = (count, 3), (count, 4), (count, 3), (count,), (count, k, 3)
        return cls(*(np.empty(shape, np.float32) for shape in shapes))

    def part(self, rows: slice) -> Self:
        """Return views of some rows."""
        return type(self)(*(array[rows] for array in self))


def chunks(count: int, rows: int | None = None) -> Iterator[slice]:
    """Yield slices of at most so many rows, by default `CHUNK`, that cover all ``count`` in order."""
    step = rows or CHUNK
    for first in range(0, count, step):
        yield slice(first, min(first + step, count))
