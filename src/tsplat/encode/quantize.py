"""Cells after the best glyph and colours are found: fewer colours, and what may stay as it is on screen."""

from __future__ import annotations

import numpy as np

from tsplat._jit import kernel, part
from tsplat.encode import palette16, palette256


@kernel
def quantize(picture, across, down, number, search, colors, glyphs):
    """Take the nearest of 16 or 256 colours; where a pattern can follow, each pixel goes to the nearer of its two."""
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
    """Return the pattern that gives each pixel the nearer colour, with the last pixel unlit if colours can swap."""
    glyph = i = 0
    for y in range(row * down, (row + 1) * down):
        for x in range(column * across, (column + 1) * across):
            r, g, b = int(picture[y, x, 0]), int(picture[y, x, 1]), int(picture[y, x, 2])
            glyph |= int(_distance(r, g, b, fore) < _distance(r, g, b, back)) << i
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


@part
def _distance(red, green, blue, code):
    r, g, b = red - (code >> 16 & 255), green - (code >> 8 & 255), blue - (code & 255)
    return r * r + g * g + b * b


@kernel
def keep(picture, across, down, lit, slack, glyphs, colors, shown, shown_colors):
    """Leave cells as they are on screen where that adds at most ``slack`` to the squared error of each pixel."""
    rows, columns = glyphs.shape
    for row in range(rows):
        for column in range(columns):
            if shown[row, column] < 0:
                continue
            glyph = lit[shown[row, column]]
            fore, back = int(shown_colors[row, column, 0]), int(shown_colors[row, column, 1])
            before = _error(picture, across, down, row, column, glyph, fore, back)
            glyph = lit[glyphs[row, column]]
            fore, back = int(colors[row, column, 0]), int(colors[row, column, 1])
            after = _error(picture, across, down, row, column, glyph, fore, back)
            if before <= after + slack * (across * down):
                glyphs[row, column] = shown[row, column]
                colors[row, column, 0], colors[row, column, 1] = (
                    shown_colors[row, column, 0],
                    shown_colors[row, column, 1],
                )


@part
def _error(picture, across, down, row, column, lit, fore, back):
    """Return the squared error of a cell's pixels against what a glyph and its colours show."""
    total = np.float32(0.0)
    i = 0
    for y in range(row * down, (row + 1) * down):
        for x in range(column * across, (column + 1) * across):
            for channel in range(3):
                shift = 16 - 8 * channel
                low, high = np.float32(back >> shift & 255), np.float32(fore >> shift & 255)
                difference = low + lit[i] * (high - low) - np.float32(picture[y, x, channel])
                total += difference * difference
            i += 1
    return total
