"""What each cell shows: the glyph and the two colours with the least squared error over the cell's pixels.

For one pattern the best colours are the means of the pixels it lights and of the others. The error is then least
where ``|lit|^2 / n + |others|^2 / m`` is greatest: sums of the pixels, less the mean of all, over their numbers.
All patterns are tried, for eight cells at once, each one pixel away from the one before it, as in a Gray code.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tsplat._jit import kernel, part
from tsplat._lanes import LANES, fma, load, splat, store, where_above
from tsplat.encode.glyphs import Shape

F32 = npt.NDArray[np.float32]

FLAT = 0.25
"""What a pattern must gain to be worth having: less than a single pixel that differs by one level does."""


class Search(NamedTuple):
    """The patterns to try, one step from each to the next.

    Attributes
    ----------
    first : int
        The pattern of a cell of one colour.
    centred : bool
        Whether the pixels that a pattern leaves have a colour of their own; else they are black.
    pixels : ndarray of int32, [S]
        The pixel that each step changes.
    signs, gains, patterns : ndarray of float32, [S]
        1 where the step lights the pixel, else -1; what the squared sum of the lit pixels counts; the pattern.
    """

    first: int
    centred: bool
    pixels: npt.NDArray[np.int32]
    signs: F32
    gains: F32
    patterns: F32


def search(shape: Shape) -> Search:
    """Return the patterns of a shape; where none is free it is always the first, the upper half block."""
    count = shape.across * shape.down
    steps = np.arange(1, 1 << shape.free)
    patterns = steps ^ steps >> 1
    pixels = np.array([(step & -step).bit_length() - 1 for step in steps.tolist()], np.int32)
    lit = np.array([pattern.bit_count() for pattern in patterns.tolist()], np.float32)
    gains = 1 / lit + 1 / (count - lit) if shape.background else 1 / lit
    signs = np.where(patterns >> pixels & 1, 1, -1)
    return Search(
        int(shape.free == 0 and shape.background),
        shape.background,
        pixels,
        signs.astype(np.float32),
        gains.astype(np.float32),
        patterns.astype(np.float32),
    )


@kernel
def split(picture, across, down, search, glyphs, colors):
    """Find the best pattern of each cell and its colours, foreground and background, in 24 bits."""
    rows, columns = glyphs.shape
    values, found = np.empty(3 * across * down * LANES, np.float32), np.empty(LANES, np.float32)
    for row in range(rows):
        for left in range(0, columns, LANES):
            _gather(picture, across, down, row, left, columns, values)
            if search.centred:
                _centre(values, across * down)
            _try_all(values, search, found)
            for lane in range(min(LANES, columns - left)):
                column = left + lane
                glyph = int(found[lane])
                fore, back = means(picture, across, down, row, column, glyph)
                if not search.centred:
                    fore, back = (fore if glyph > 0 else 0), 0
                glyphs[row, column] = search.first if fore == back else glyph
                colors[row, column, 0], colors[row, column, 1] = fore, back


@part
def _gather(picture, across, down, row, left, columns, values):
    """Copy the pixels of eight cells, each channel of each pixel as eight lanes; the last cell stands for more."""
    at = 0
    for y in range(row * down, (row + 1) * down):
        for x in range(across):
            for channel in range(3):
                for lane in range(LANES):
                    column = min(left + lane, columns - 1)
                    values[at + lane] = picture[y, column * across + x, channel]
                at += LANES


@part
def _centre(values, count):
    """Take the mean of all pixels from each."""
    share = splat(np.float32(1.0 / count))
    for channel in range(3):
        total = splat(np.float32(0.0))
        for i in range(count):
            total = total + load(values, (3 * i + channel) * LANES)
        mean = total * share
        for i in range(count):
            at = (3 * i + channel) * LANES
            store(values, at, load(values, at) - mean)


@part
def _try_all(values, search, found):
    """Put the best pattern of each of eight cells into ``found``."""
    red = green = blue = splat(np.float32(0.0))
    most, best = splat(np.float32(FLAT)), splat(np.float32(search.first))
    for step in range(len(search.pixels)):
        at = np.int64(search.pixels[step]) * (3 * LANES)
        sign = splat(search.signs[step])
        red = fma(sign, load(values, at), red)
        green = fma(sign, load(values, at + LANES), green)
        blue = fma(sign, load(values, at + 2 * LANES), blue)
        gain = fma(red, red, fma(green, green, blue * blue)) * splat(search.gains[step])
        best = where_above(gain, most, splat(search.patterns[step]), best)
        most = where_above(gain, most, gain, most)
    store(found, 0, best)


@part
def means(picture, across, down, row, column, glyph):
    """Return the mean colours of the pixels that a pattern lights and of the others; one for both where none are."""
    red = green = blue = lit_red = lit_green = lit_blue = lit = i = 0
    for y in range(row * down, (row + 1) * down):
        for x in range(column * across, (column + 1) * across):
            r, g, b = int(picture[y, x, 0]), int(picture[y, x, 1]), int(picture[y, x, 2])
            mask = -(glyph >> i & 1)
            red, green, blue = red + r, green + g, blue + b
            lit_red, lit_green, lit_blue = lit_red + (r & mask), lit_green + (g & mask), lit_blue + (b & mask)
            lit -= mask
            i += 1
    others = i - lit
    fore = _mean(lit_red, lit_green, lit_blue, lit)
    back = _mean(red - lit_red, green - lit_green, blue - lit_blue, others)
    return (fore if lit > 0 else back), (back if others > 0 else fore)


@part
def _mean(red, green, blue, count):
    share = np.float32(1.0) / np.float32(max(count, 1))
    half = np.float32(0.5)
    return (
        int(np.float32(red) * share + half) << 16
        | int(np.float32(green) * share + half) << 8
        | int(np.float32(blue) * share + half)
    )
