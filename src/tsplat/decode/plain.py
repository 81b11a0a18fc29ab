"""Bytes and bit fields of packed splats to float32, in NumPy: slow, and what `tsplat.decode.kernels` means.

Sums in float64 are of products that are exact there, so their bits are the same whether a processor rounds once or
twice. Inputs are C-ordered, so that each kernel is compiled once.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

F32 = npt.NDArray[np.float32]
U8 = npt.NDArray[np.uint8]
U32 = npt.NDArray[np.uint32]

FIELD_BITS = 10
"""Bits of each smaller component of a quat."""


def look_up(steps: U8, columns: U8, levels: F32, first: int, out: F32) -> None:
    """Put what bytes stand for into adjacent columns.

    Parameters
    ----------
    steps : ndarray of uint8, [N, M]
        The bytes of each splat.
    columns : ndarray of uint8, [W]
        Which of them to take, and in which order; below M.
    levels : ndarray of float32, [256]
        What each byte stands for.
    first : int
        Where in ``out`` the first of them belongs.
    out : ndarray of float32, [N, first + W or more]
        Other columns stay as they are.
    """
    chosen = np.take(steps, columns, axis=1, mode="clip")
    out[:, first : first + len(columns)] = np.take(levels, chosen, mode="clip")


def scale(steps: U8, middle: np.float32, factors: F32, first: int, out: F32) -> None:
    """Put distances of bytes from the middle, times a factor for each column, into adjacent columns.

    Parameters
    ----------
    steps : ndarray of uint8, [N, W]
        The bytes of each splat.
    middle : np.float32
        Byte that stands for 0, a multiple of 0.5.
    factors : ndarray of float32, [W]
        What one more stands for.
    first, out
        As for `look_up`.
    """
    np.multiply(np.subtract(steps, middle, dtype=np.float32), factors, out=out[:, first : first + len(factors)])


def between(words: U32, shifts: U32, tops: U32, low: F32, high: F32, group: int, out: F32) -> None:
    """Put three bit fields of each word between the bounds of its group.

    A field of nothing but 0 or 1 gives the bound itself.

    Parameters
    ----------
    words : ndarray of uint32, [N]
        They fill all of G groups but the last.
    shifts, tops : ndarray of uint32, [3]
        Where each field begins, and its highest value, below 2 ** 29.
    low, high : ndarray of float32, [G, 3]
        What 0 and the highest value stand for.
    group : int
        How many words share their bounds.
    out : ndarray of float32, [N, 3 or more]
        Other columns stay as they are.
    """
    for axis in range(3):
        whole = np.float64(tops[axis])
        least, most = (np.repeat(ends[:, axis].astype(np.float64), group)[: len(words)] for ends in (low, high))
        step = (words >> shifts[axis] & tops[axis]).astype(np.float64)
        out[:, axis] = (least * (whole - step) + most * step) * (1.0 / whole)


def smallest_three(words: U32, levels: F32, places: U8, out: F32) -> None:
    """Make unit quats of their three smaller components; the largest, not negative, follows from them.

    Parameters
    ----------
    words : ndarray of uint32, [N]
        Two bits for the number of the largest, then three fields of `FIELD_BITS`.
    levels : ndarray of float32, [1 << FIELD_BITS]
        What a field stands for.
    places : ndarray of uint8, [4, 4]
        For each number of the largest: its place in a row of ``out``, and those of the others, highest field
        first.
    out : ndarray of float32, [N, 4]
        Becomes the quats. Three components that are longer than 1 together are shortened, and the largest is 0.
    """
    shifts = np.array([2 * FIELD_BITS, FIELD_BITS, 0], np.uint32)
    fields = words >> shifts[:, None] & np.uint32((1 << FIELD_BITS) - 1)
    x, y, z = np.take(levels, fields, mode="clip").astype(np.float64)
    squares = x * x + y * y + z * z
    factor = 1.0 / np.sqrt(np.maximum(1.0, squares))
    largest = np.sqrt(np.maximum(0.0, 1.0 - squares))
    four = np.array([largest, x * factor, y * factor, z * factor], np.float32)
    # Taking is quicker than putting: where each place's value is, in rows of N.
    sources = np.argsort(places, axis=1) * len(words)
    found = np.take(sources, words >> 3 * FIELD_BITS, axis=0, mode="clip") + np.arange(len(words))[:, None]
    np.take(four, found, out=out, mode="clip")
