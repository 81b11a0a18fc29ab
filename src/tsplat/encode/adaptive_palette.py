"""The colours that suit a frame, found by median cut and kept while they still suit the frames that follow."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from tsplat._jit import JIT, kernel
from tsplat.encode.palette_lookup import look_up, look_up_dithered, look_up_lazily
from tsplat.encode.protocol import U8

I32 = npt.NDArray[np.int32]

_THUMBNAIL = (100, 60)
"""Most pixels, across and down, that a palette is made from and judged by."""

_ERROR_GROWTH = 1.5
_ERROR_SLACK = 4.0
"""A palette is made anew when its mean squared error is beyond growth times what it was at first, plus slack.
Making one costs three frames and shifts all colours a little, which the eye sees as a flicker."""


_BACKGROUND_SHARE = 0.05
"""A colour of so large a part of the frame is taken for its background. Median cut keeps it as it is, but the
middle of its bin may lie nearer to another colour; and what one sees first is when a whole background changes."""

_SPREAD_PER_ERROR = 3.46
"""Colours that lie a step apart have a root mean squared error of this part of it, the square root of 12."""

_PACKING = np.array([1 << 16, 1 << 8, 1], np.int32)
"""Red, green and blue times this is 0xRRGGBB."""


class AdaptivePalette:
    """Up to 256 colours and the nearest of them for every colour, in bins of 15 bits.

    Parameters
    ----------
    size : int
        How many colours there may be, from 2 to 256.
    """

    def __init__(self, size: int = 256) -> None:
        self.size = size
        self.colors: U8 = np.zeros((256, 3), np.uint8)
        """Colours as the terminal shows them, uint8 [256, 3]; beyond ``size`` the last one is repeated."""
        self.index_from_bin: U8 = np.zeros(1 << 15, np.uint8)
        """Nearest colour of each bin; see `bin_from_color`."""
        self.registers = b""
        """Sixel commands that define the colours."""
        self.spread = 0
        """How far apart neighbouring colours lie in each channel, roughly: the reach of a dither."""
        self._largest_error = -1.0
        self._background = -1  # as 0xRRGGBB; -1 is none

    def fit(self, frame: U8) -> U8:
        """Return ``index_from_bin`` for a frame, made anew when the colours no longer suit it."""
        height, width = frame.shape[:2]
        across, down = -(-width // _THUMBNAIL[0]), -(-height // _THUMBNAIL[1])
        thumbnail = np.ascontiguousarray(frame[::down, ::across])
        if self._error(thumbnail) > self._largest_error:
            self._rebuild(thumbnail)
            error = self._error(thumbnail)
            self._largest_error = _ERROR_GROWTH * error + _ERROR_SLACK
            self.spread = round(_SPREAD_PER_ERROR * error**0.5)
        return self.index_from_bin

    def indices(self, frame: U8, *, tolerance: int = 0, dither: bool = False) -> U8:
        """Return the colour of each pixel as an index, uint8 [H, W].

        Parameters
        ----------
        frame : ndarray of uint8, [H, W, 3]
            In C order.
        tolerance : int
            A pixel takes the colour of the one above it, else of the one on its left, when that colour is no
            further off than this many levels: longer runs, fewer bytes. 0 always takes the nearest, and so does
            the background, into which the edges of things would run.
        dither : bool
            Mix colours in a pattern of 4 x 4 pixels where none of them is near. Rules out a tolerance.
        """
        found = np.empty(frame.shape[:2], np.uint8)
        if dither:
            look_up_dithered(frame, self.index_from_bin, self.spread, found)
        elif tolerance:
            packed = self.colors.astype(np.int32) @ _PACKING
            limit = tolerance * tolerance
            look_up_lazily(frame, self.index_from_bin, packed, self._background, limit, found)
        else:
            look_up(frame, self.index_from_bin, found)
        return found

    def quantize(self, frame: U8) -> U8:
        """Return the frame in these colours, uint8 [H, W, 3]."""
        return self.colors[self.index_from_bin[bin_from_color(frame)]]

    def _error(self, frame: U8) -> float:
        difference = self.quantize(frame).astype(np.float32) - frame
        return float(np.mean(difference * difference))

    def _rebuild(self, thumbnail: U8) -> None:
        from PIL import Image

        cut = Image.fromarray(thumbnail).quantize(self.size, Image.Quantize.MEDIANCUT)
        found = np.array(cut.getpalette(), np.int32).reshape(-1, 3)[: int(np.asarray(cut).max()) + 1]
        # What is missing repeats the last colour, which the first of the equals always wins.
        colors = np.concatenate([found, np.repeat(found[-1:], 256 - len(found), axis=0)])
        # Sixel says colours in percent.
        percent = (colors * 100 + 127) // 255
        self.colors = ((percent * 255 + 50) // 100).astype(np.uint8)
        self.registers = b"".join(
            b"#%d;2;%d;%d;%d" % (index, *color) for index, color in enumerate(percent[: len(found)].tolist())
        )
        _fill(np.ascontiguousarray(self.colors.T, np.int32), self.index_from_bin)
        self._background = _common_color(thumbnail)
        if self._background >= 0:
            background = np.array([self._background >> 16, self._background >> 8 & 255, self._background & 255])
            nearest = np.argmin(((self.colors - background) ** 2).sum(axis=1))
            self.index_from_bin[bin_from_color(background.astype(np.uint8))] = nearest


def _common_color(frame: U8) -> int:
    """Return the colour of the background as 0xRRGGBB, or -1 where there is none."""
    colors, counts = np.unique(frame.astype(np.int32) @ _PACKING, return_counts=True)
    commonest = int(np.argmax(counts))
    return int(colors[commonest]) if counts[commonest] >= _BACKGROUND_SHARE * counts.sum() else -1


def bin_from_color(frame: U8) -> npt.NDArray[np.uint16]:
    """Return the upper five bits of red, green and blue of each pixel as one number, below 32768."""
    five = (frame >> 3).astype(np.uint16)
    return (five[..., 0] << 10 | five[..., 1] << 5 | five[..., 2]).astype(np.uint16, copy=False)


@kernel
def _fill_nearest(colors: I32, index_from_bin: U8) -> None:
    for bin_index in range(len(index_from_bin)):
        red = np.int32((bin_index >> 10) * 8 + 4)
        green = np.int32((bin_index >> 5 & 31) * 8 + 4)
        blue = np.int32((bin_index & 31) * 8 + 4)
        # The distance above, the index below: one minimum of 32 bits, which LLVM takes eight at a time.
        best = np.int32(0x7FFFFFFF)
        for index in range(256):
            r, g, b = colors[0, index] - red, colors[1, index] - green, colors[2, index] - blue
            best = min(best, np.int32(np.int32(r * r + g * g + b * b) << 8) | np.int32(index))
        index_from_bin[bin_index] = best & 255


def _fill_nearest_plain(colors: I32, index_from_bin: U8) -> None:
    # The kernel is eight million steps, a minute without compilation.
    bins = np.arange(len(index_from_bin))
    middles = np.stack([bins >> 10, bins >> 5 & 31, bins & 31]) * 8 + 4
    distances = sum((colors[c, None, :] - middles[c, :, None]) ** 2 for c in range(3))
    index_from_bin[:] = np.argmin(distances, axis=1)


_fill: Callable[[I32, U8], None] = _fill_nearest if JIT else _fill_nearest_plain
