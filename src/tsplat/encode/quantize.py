"""Cells after the best glyph and colours are found: fewer colours, and what may stay as it is on screen."""

from __future__ import annotations

import numpy as np

from tsplat._jit import kernel, part
from tsplat.encode import palette16, palette256
from tsplat.encode.cell_text import NONE


@kernel
def quantize(picture, across, down, number, search, colors, glyphs):
    """Take the nearest of 16 or 256 colours, and patterns where each pixel has the nearer of its two."""
    rows, columns = glyphs.shape
    for row in range(rows):
        for column in range(columns):
            fore = _code(int(colors[row, column, 0]), number)
            back = _code(int(colors[row, column, 1]), number)
            colors[row, column, 0], colors[row, column, 1] = fore, back
            if fore == back:
                glyphs[row, column] = search.first
            elif len(search.pixels) > 0:
                glyph, fore, back = _assign(picture, across, down, row, column, fore, back, search.centred)
                glyphs[row, column], colors[row, column, 0], colors[row, column, 1] = glyph, fore, back


@part
def _code(color, number):
    red, green, blue = color >> 16 & 255, color >> 8 & 255, color & 255
    if number == 16:
        index = palette16.nearest(red, green, blue)
        shown = palette16.COLORS[index]
    else:
        index = palette256.nearest(red, green, blue)
        shown = palette256.COLORS[index]
    return index << 24 | int(shown[0]) << 16 | int(shown[1]) << 8 | int(shown[2])


@part
def _assign(picture, across, down, row, column, fore, back, centred):
    """Return the pattern that gives each pixel the nearer colour; the last one is unlit if colours can swap."""
    red, green, blue = fore >> 16 & 255, fore >> 8 & 255, fore & 255
    other_red, other_green, other_blue = back >> 16 & 255, back >> 8 & 255, back & 255
    # Which is nearer depends on which side of the plane halfway between them the pixel lies.
    r, g, b = 2 * (red - other_red), 2 * (green - other_green), 2 * (blue - other_blue)
    plane = red * red + green * green + blue * blue
    plane -= other_red * other_red + other_green * other_green + other_blue * other_blue
    glyph, i = np.int64(0), 0
    for y in range(row * down, (row + 1) * down):
        for x in range(column * across, (column + 1) * across):
            u, v = np.uint64(y), np.uint64(x)
            side = r * int(picture[u, v, 0]) + g * int(picture[u, v, 1]) + b * int(picture[u, v, 2])
            glyph |= np.int64(side > plane) << i
            i += 1
    every = (1 << i) - 1
    if glyph == 0:
        return 0, back, back
    if not centred:
        return glyph, fore, back
    if glyph == every:
        return 0, fore, fore
    if glyph >> (i - 1):
        return every ^ glyph, back, fore
    return glyph, fore, back


@kernel
def keep(picture, across, down, lit, slack, glyphs, colors, shown, shown_colors):
    """Leave cells as they are on screen where that adds at most ``slack`` to the squared error of each pixel."""
    if slack <= 0:
        return
    rows, columns = glyphs.shape
    for row in range(rows):
        for column in range(columns):
            if shown[row, column] < 0:
                continue
            glyph = lit[shown[row, column]]
            fore, back = int(shown_colors[row, column, 0]), _ground(int(shown_colors[row, column, 1]))
            before = _error(picture, across, down, row, column, glyph, fore, back)
            glyph = lit[glyphs[row, column]]
            fore, back = int(colors[row, column, 0]), _ground(int(colors[row, column, 1]))
            after = _error(picture, across, down, row, column, glyph, fore, back)
            if before <= after + slack * (across * down):
                glyphs[row, column] = shown[row, column]
                colors[row, column, 0], colors[row, column, 1] = (
                    shown_colors[row, column, 0],
                    shown_colors[row, column, 1],
                )


@part
def _ground(code):
    # Without colours, what is not lit is taken for black; what is lit, for white, as the code happens to say.
    return 0 if code == NONE else code


@part
def _error(picture, across, down, row, column, lit, fore, back):
    """Return the squared error of a cell's pixels against what a glyph and its colours show."""
    total = np.float32(0.0)
    i = 0
    low_red, low_green, low_blue = _channels(back)
    red, green, blue = _channels(fore)
    red, green, blue = red - low_red, green - low_green, blue - low_blue
    for y in range(row * down, (row + 1) * down):
        for x in range(column * across, (column + 1) * across):
            u, v, share = np.uint64(y), np.uint64(x), lit[np.uint64(i)]
            r = low_red + share * red - np.float32(picture[u, v, 0])
            g = low_green + share * green - np.float32(picture[u, v, 1])
            b = low_blue + share * blue - np.float32(picture[u, v, 2])
            total += r * r + g * g + b * b
            i += 1
    return total


@part
def _channels(code):
    return np.float32(code >> 16 & 255), np.float32(code >> 8 & 255), np.float32(code & 255)
