"""The 256 colours every terminal agrees on: a 6x6x6 cube and 24 greys; 0 to 15 belong to the person's theme."""

from __future__ import annotations

import numpy as np

from tsplat._jit import part
from tsplat.encode.protocol import U8

CUBE_LEVELS = (0, 95, 135, 175, 215, 255)
GREY_LEVELS = tuple(range(8, 239, 10))
FIRST_CUBE, FIRST_GREY = 16, 232


def _palette() -> U8:
    colors = np.zeros((256, 3), np.uint8)
    colors[FIRST_CUBE:FIRST_GREY] = [(r, g, b) for r in CUBE_LEVELS for g in CUBE_LEVELS for b in CUBE_LEVELS]
    colors[FIRST_GREY:] = np.array(GREY_LEVELS)[:, None]
    return colors


COLORS = _palette()
"""By their number, uint8 [256, 3]; zero where themes decide."""


def _nearest_level(values: range, levels: tuple[int, ...], scale: int) -> U8:
    distance = np.abs(np.array(values)[:, None] - scale * np.array(levels)[None, :])
    nearest: U8 = distance.argmin(axis=1).astype(np.uint8)
    return nearest


_CUBE_INDEX = _nearest_level(range(256), CUBE_LEVELS, 1)
# A grey is nearest where it is nearest to the mean of the channels, here three times it.
_GREY_INDEX = _nearest_level(range(3 * 255 + 1), GREY_LEVELS, 3)
_CUBE_ERROR = (np.arange(256) - np.array(CUBE_LEVELS)[_CUBE_INDEX]).astype(np.int32) ** 2


@part
def nearest(red, green, blue):
    """Return the number of the colour nearest to this one by Euclidean distance in RGB.

    The cube's colour is nearest channel by channel and the grey depends only on the channels' sum,
    so the better of the two is exact, without a table of all colours.
    """
    cube_error = _CUBE_ERROR[red] + _CUBE_ERROR[green] + _CUBE_ERROR[blue]
    grey = int(_GREY_INDEX[red + green + blue])
    r, g, b = red - (8 + 10 * grey), green - (8 + 10 * grey), blue - (8 + 10 * grey)
    if cube_error <= r * r + g * g + b * b:
        return FIRST_CUBE + 36 * int(_CUBE_INDEX[red]) + 6 * int(_CUBE_INDEX[green]) + int(_CUBE_INDEX[blue])
    return FIRST_GREY + grey
