"""The colours of a frame's pixels as indices into a palette, by a table with a bin for each 15-bit colour."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tsplat._jit import kernel, part
from tsplat.encode.protocol import U8

I32 = npt.NDArray[np.int32]

_BAYER = np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]], np.int32)
"""Bayer's order of 16 thresholds: neighbours in it lie far apart."""


@part
def _bin(red: int, green: int, blue: int) -> int:
    return (red >> 3) << 10 | (green >> 3) << 5 | blue >> 3


@kernel
def look_up(frame: U8, index_from_bin: U8, found: U8) -> None:
    """Give each pixel the nearest colour."""
    height, width = found.shape
    for y in range(height):
        for x in range(width):
            found[y, x] = index_from_bin[_bin(int(frame[y, x, 0]), int(frame[y, x, 1]), int(frame[y, x, 2]))]


@kernel
def look_up_dithered(frame: U8, index_from_bin: U8, spread: int, found: U8) -> None:
    """Give each pixel the colour nearest to it and a part of ``spread``, by its place in the pattern."""
    height, width = found.shape
    for y in range(height):
        for x in range(width):
            # Thresholds from -15/32 to 15/32 of the spread: on average nothing is added.
            offset = (2 * _BAYER[y & 3, x & 3] - 15) * spread // 32
            red = min(max(int(frame[y, x, 0]) + offset, 0), 255)
            green = min(max(int(frame[y, x, 1]) + offset, 0), 255)
            blue = min(max(int(frame[y, x, 2]) + offset, 0), 255)
            found[y, x] = index_from_bin[_bin(red, green, blue)]


@part
def _distance(red: int, green: int, blue: int, color: int) -> int:
    red, green, blue = red - (color >> 16), green - (color >> 8 & 255), blue - (color & 255)
    return red * red + green * green + blue * blue


@kernel
def look_up_lazily(frame: U8, index_from_bin: U8, packed: I32, background: int, most: int, found: U8) -> None:
    """Let a pixel take the colour above it or on its left where the square of the distance is at most ``most``.

    ``packed`` has the colours as 0xRRGGBB; pixels that are exactly ``background`` take the nearest colour.
    """
    height, width = found.shape
    for y in range(height):
        above = found[max(y - 1, 0)]
        left = index_from_bin[_bin(int(frame[y, 0, 0]), int(frame[y, 0, 1]), int(frame[y, 0, 2]))]
        if y == 0:
            above[:] = left
        left_color = packed[left]
        for x in range(width):
            red, green, blue = int(frame[y, x, 0]), int(frame[y, x, 1]), int(frame[y, x, 2])
            # Selections instead of branches: which of the three it is cannot be foreseen.
            # What need not wait for the pixel on the left comes first.
            other = index_from_bin[_bin(red, green, blue)]
            limit = -1 if (red << 16 | green << 8 | blue) == background else most
            near_above = _distance(red, green, blue, packed[above[x]]) <= limit
            other = above[x] if near_above else other
            other_color = packed[other]
            stays = _distance(red, green, blue, left_color) <= limit and not near_above
            left, left_color = (left, left_color) if stays else (other, other_color)
            found[y, x] = left
