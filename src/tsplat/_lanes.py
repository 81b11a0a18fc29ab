"""Eight float32 lanes: the small vocabulary in which kernels spell SIMD.

Eight lanes support ``+ - * /`` among themselves and the functions below. In Python they are float32 [8]
arrays; in a kernel each word is a few instructions, see `tsplat._llvm.lanes`. So a kernel reads the same
and does the same either way.
"""

from __future__ import annotations

from typing import Any

import numpy as np

LANES = 8

EXP2_CUBIC = (0.0551716672, 0.2426111221, 0.6932609858, 0.9999280736)
"""2**f for f in [-0.5, 0.5], highest power first: the least relative error a cubic can have, 7.5e-5."""

ROUNDING_MAGIC = 12582912.0
"""1.5 * 2**23: adding it leaves the nearest integer in the low bits of a float32."""


def splat(value: Any) -> Any:
    """Eight times the same float32."""
    return np.full(LANES, value, np.float32)


def load(array: Any, offset: Any) -> Any:
    """The eight values of a flat float32 array that start at ``offset``."""
    return array[offset : offset + LANES].copy()


def store(array: Any, offset: Any, value: Any) -> None:
    """Put eight values into a flat float32 array from ``offset`` on."""
    array[offset : offset + LANES] = value


def fma(x: Any, y: Any, z: Any) -> Any:
    """``x * y + z``, rounded once where the processor can."""
    return x * y + z


def minimum(x: Any, y: Any) -> Any:
    """The smaller of two lanes; ``y`` where either is nan."""
    return np.where(x < y, x, y)


def maximum(x: Any, y: Any) -> Any:
    """The larger of two lanes; ``y`` where either is nan."""
    return np.where(x > y, x, y)


def where_at_least(x: Any, limit: Any, value: Any) -> Any:
    """``value`` where ``x >= limit``, else 0."""
    return np.where(x >= limit, value, np.float32(0.0))


def where_above(x: Any, limit: Any, value: Any, other: Any) -> Any:
    """``value`` where ``x > limit``, else ``other``."""
    return np.where(x > limit, value, other)


def minus_abs(x: Any) -> Any:
    """``-|x|``."""
    return -np.abs(x)


def exp2(x: Any) -> Any:
    """``2**x`` to a relative 1e-4 for x in [-120, 120]; anything, never a trap, elsewhere."""
    shifted = x + np.float32(ROUNDING_MAGIC)
    fraction = x - (shifted - np.float32(ROUNDING_MAGIC))
    power = np.full(LANES, EXP2_CUBIC[0], np.float32)
    for coefficient in EXP2_CUBIC[1:]:
        power = power * fraction + np.float32(coefficient)
    return (power.view(np.int32) + (shifted.view(np.int32) << 23)).view(np.float32)


def eighth_power(x: Any) -> Any:
    """``x**8``; infinity where that is too large."""
    with np.errstate(over="ignore"):
        return x**8


def sqrt(x: Any) -> Any:
    """Square roots; nan below zero."""
    with np.errstate(invalid="ignore"):
        return np.sqrt(x)
