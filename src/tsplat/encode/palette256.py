"""The 256 colours every terminal agrees on: a 6x6x6 cube and 24 greys; 0 to 15 belong to the person's theme."""

from __future__ import annotations

import numpy as np

from tsplat.encode.protocol import U8

CUBE_LEVELS = (0, 95, 135, 175, 215, 255)
GREY_LEVELS = tuple(range(8, 239, 10))
FIRST_CUBE, FIRST_GREY = 16, 232


def _nearest(values: range, levels: tuple[int, ...], scale: int) -> tuple[np.ndarray, np.ndarray]:
    distance = np.abs(np.array(values)[:, None] - scale * np.array(levels)[None, :])
    index = distance.argmin(axis=1)
    return index.astype(np.uint8), np.array(levels, np.uint8)[index]


_CUBE_INDEX, _CUBE_VALUE = _nearest(range(256), CUBE_LEVELS, 1)
# A grey is nearest where it is nearest to the mean of the channels, here three times it.
_GREY_INDEX, _GREY_VALUE = _nearest(range(3 * 255 + 1), GREY_LEVELS, 3)
_CUBE_ERROR = (np.arange(256) - _CUBE_VALUE.astype(np.int32)) ** 2


def nearest_index(frame: U8) -> U8:
    """Return the index, 16 to 255, of the colour nearest to each pixel by Euclidean distance in RGB.

    The cube's colour is nearest channel by channel and the grey depends only on the channels' sum,
    so the better of the two is exact, without a table of all colours.

    Parameters
    ----------
    frame : ndarray of uint8, [..., 3]

    Returns
    -------
    ndarray of uint8, [...]
    """
    red, green, blue = (np.ascontiguousarray(frame[..., channel]) for channel in range(3))
    cube = 36 * _CUBE_INDEX[red] + 6 * _CUBE_INDEX[green] + _CUBE_INDEX[blue] + FIRST_CUBE
    cube_error = _CUBE_ERROR[red] + _CUBE_ERROR[green] + _CUBE_ERROR[blue]
    total = red.astype(np.uint16) + green + blue
    level = _GREY_VALUE[total].astype(np.int32)
    grey_error = (red - level) ** 2 + (green - level) ** 2 + (blue - level) ** 2
    nearest: U8 = np.where(cube_error <= grey_error, cube, _GREY_INDEX[total] + FIRST_GREY).astype(np.uint8)
    return nearest
