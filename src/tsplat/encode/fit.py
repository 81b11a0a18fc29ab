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
from tsplat._lanes import LANES, fma, load, maximum, splat, store, where_above, where_at_least
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
    values, found : ndarray of float32
        Room for the pixels of eight cells, and for what is found for them.
    """

    first: int
    centred: bool
    pixels: npt.NDArray[np.int32]
    signs: F32
    gains: F32
    patterns: F32
    values: F32
    found: F32


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
        np.empty(3 * (count + 1) * LANES, np.float32),
        np.empty(7 * LANES, np.float32),
    )


@kernel
def split(picture, across, down, search, glyphs, colors):
    """Find the best pattern of each cell and its colours, foreground and background, in 24 bits."""
    rows, columns = glyphs.shape
    values, found = search.values, search.found
    for row in range(rows):
        for left in range(0, columns, LANES):
            cells = min(LANES, columns - left)
            _gather(picture, across, down, row, left, cells, values)
            _centre(values, across * down, search.centred)
            _try_all(values, search, found)
            _color_all(values, across * down, search.centred, found)
            for lane in range(cells):
                fore, back = _rounded(found, LANES + lane), _rounded(found, 4 * LANES + lane)
                glyph = np.int64(found[lane])
                glyphs[row, left + lane] = search.first if fore == back else glyph
                colors[row, left + lane, 0], colors[row, left + lane, 1] = fore, back


@part
def _gather(picture, across, down, row, left, cells, values):
    """Copy the pixels of up to eight cells, each channel of each pixel as eight lanes."""
    at = np.uint64(0)
    for y in range(row * down, (row + 1) * down):
        for x in range(across):
            for lane in range(cells):
                column, to = np.uint64((left + lane) * across + x), at + np.uint64(lane)
                values[to] = picture[np.uint64(y), column, 0]
                values[to + np.uint64(LANES)] = picture[np.uint64(y), column, 1]
                values[to + np.uint64(2 * LANES)] = picture[np.uint64(y), column, 2]
            at += np.uint64(3 * LANES)


@part
def _centre(values, count, centred):
    """Take the mean of all pixels from each and put it behind them; black, where cells are not to be centred."""
    share = splat(np.float32(1.0 / count if centred else 0.0))
    for channel in range(3):
        total = splat(np.float32(0.0))
        for i in range(count):
            total = total + load(values, (3 * i + channel) * LANES)
        mean = total * share
        for i in range(count):
            at = (3 * i + channel) * LANES
            store(values, at, load(values, at) - mean)
        store(values, (3 * count + channel) * LANES, mean)


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
def _color_all(values, count, centred, found):
    """Put behind the patterns the mean colours of the pixels that they light, then of the others."""
    one = splat(np.float32(1.0))
    red = green = blue = lit = splat(np.float32(0.0))
    rest = load(found, 0)
    for i in range(count - 1, -1, -1):
        bit = splat(np.float32(1 << i))
        taken = where_at_least(rest, bit, one)
        rest = rest - taken * bit
        lit = lit + taken
        red = fma(taken, load(values, 3 * i * LANES), red)
        green = fma(taken, load(values, (3 * i + 1) * LANES), green)
        blue = fma(taken, load(values, (3 * i + 2) * LANES), blue)
    _put_means(values, 3 * count * LANES, red, green, blue, one / maximum(lit, one), found, LANES)
    # All pixels together are nought; what is not lit is the rest of it.
    others = splat(np.float32(0.0)) - one / maximum(splat(np.float32(count)) - lit, one)
    share = others if centred else splat(np.float32(0.0))
    _put_means(values, 3 * count * LANES, red, green, blue, share, found, 4 * LANES)


@part
def _put_means(values, mean, red, green, blue, share, found, at):
    store(found, at, fma(red, share, load(values, mean)))
    store(found, at + LANES, fma(green, share, load(values, mean + LANES)))
    store(found, at + 2 * LANES, fma(blue, share, load(values, mean + 2 * LANES)))


@part
def _rounded(found, at):
    half = np.float32(0.5)
    red, green, blue = found[at] + half, found[at + LANES] + half, found[at + 2 * LANES] + half
    return np.int64(red) << 16 | np.int64(green) << 8 | np.int64(blue)
