"""The 16 colours that every terminal has, as xterm shows them; themes change them a little."""

from __future__ import annotations

import numpy as np

from tsplat._jit import part
from tsplat.encode.protocol import U8

COLORS: U8 = np.array(
    [
        (0, 0, 0), (205, 0, 0), (0, 205, 0), (205, 205, 0),
        (0, 0, 238), (205, 0, 205), (0, 205, 205), (229, 229, 229),
        (127, 127, 127), (255, 0, 0), (0, 255, 0), (255, 255, 0),
        (92, 92, 255), (255, 0, 255), (0, 255, 255), (255, 255, 255),
    ],
    np.uint8,
)  # fmt: skip
"""By their number, 8 to 15 the bright ones, uint8 [16, 3]."""

_RED, _GREEN, _BLUE = (np.ascontiguousarray(COLORS[:, channel], np.int32) for channel in range(3))


@part
def nearest(red, green, blue):
    """Return the number of the colour nearest to this one by Euclidean distance in RGB."""
    # The distance above, the number below: one minimum.
    best = 1 << 30
    for index in range(16):
        r, g, b = _RED[index] - red, _GREEN[index] - green, _BLUE[index] - blue
        best = min(best, (r * r + g * g + b * b) << 4 | index)
    return best & 15
