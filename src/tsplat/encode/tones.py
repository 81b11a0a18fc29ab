"""Cells by brightness: a ramp of glyphs, patterns where there is no colour, and noise where colours are few."""

from __future__ import annotations

import numpy as np

from tsplat._jit import kernel, part

LUMA = 54, 183, 19
"""How bright each primary looks, ITU-R BT.709, in 256 parts."""

_BAYER_2 = np.array([[0, 2], [3, 1]])
_BAYER_4 = np.block([[4 * _BAYER_2, 4 * _BAYER_2 + 2], [4 * _BAYER_2 + 3, 4 * _BAYER_2 + 1]])
THRESHOLDS = (256 * (16 * np.tile(_BAYER_4, (2, 2)) + np.kron(_BAYER_2, np.full((4, 4), 4)) + 2)).astype(np.int32)
"""Brightness, in 65536 parts, from which a pixel is lit where there is no colour; see `dither`."""

SPREAD = 96
"""How far apart `spread` moves pixels of one colour, of 255: a little less than the 16 colours are."""


@kernel
def shade(picture, across, down, ink, glyphs, colors):
    """Take the faintest glyph that is bright enough and the colour that makes it just as bright as the pixels."""
    rows, columns = glyphs.shape
    for row in range(rows):
        for column in range(columns):
            red, green, blue = _mean(picture, across, down, row, column)
            glyph = 0
            while glyph < len(ink) - 1 and ink[glyph] * np.float32(255.0) < max(red, green, blue):
                glyph += 1
            glyphs[row, column] = glyph
            share = np.float32(1.0) / max(ink[glyph], np.float32(1e-3))
            colors[row, column, 0] = 0
            if glyph > 0:
                half = np.float32(0.5)
                fore = np.int64(red * share + half) << 16 | np.int64(green * share + half) << 8
                colors[row, column, 0] = fore | np.int64(blue * share + half)
            colors[row, column, 1] = 0


@part
def _mean(picture, across, down, row, column):
    red = green = blue = 0
    for y in range(row * down, (row + 1) * down):
        for x in range(column * across, (column + 1) * across):
            red, green, blue = red + picture[y, x, 0], green + picture[y, x, 1], blue + picture[y, x, 2]
    share = np.float32(1.0 / (across * down))
    return np.float32(red) * share, np.float32(green) * share, np.float32(blue) * share


@kernel
def dither(picture, across, down, glyphs):
    """Light a pixel where it is brighter than its threshold, which is the same in each frame."""
    rows, columns = glyphs.shape
    for row in range(rows):
        for column in range(columns):
            glyph = i = 0
            for y in range(row * down, (row + 1) * down):
                for x in range(column * across, (column + 1) * across):
                    glyph |= int(_luma(picture, y, x) >= THRESHOLDS[y & 7, x & 7]) << i
                    i += 1
            glyphs[row, column] = glyph


@kernel
def grade(picture, across, down, ink, glyphs):
    """Take the glyph whose brightness is nearest to the cell's."""
    rows, columns = glyphs.shape
    for row in range(rows):
        for column in range(columns):
            total = 0
            for y in range(row * down, (row + 1) * down):
                for x in range(column * across, (column + 1) * across):
                    total += _luma(picture, y, x)
            wanted = np.float32(total) / np.float32(across * down * 255 * 256)
            glyph = 0
            while glyph < len(ink) - 1 and ink[glyph] + ink[glyph + 1] < 2 * wanted:
                glyph += 1
            glyphs[row, column] = glyph


@part
def _luma(picture, y, x):
    red, green, blue = LUMA
    return red * int(picture[y, x, 0]) + green * int(picture[y, x, 1]) + blue * int(picture[y, x, 2])


@kernel
def spread(picture, result):
    """Make pixels a little brighter or darker, in a pattern that is the same in each frame."""
    height, width = picture.shape[:2]
    for y in range(height):
        for x in range(width):
            offset = (np.int64(THRESHOLDS[y & 7, x & 7]) - 32768) * SPREAD >> 16
            for channel in range(3):
                value = np.int64(picture[np.uint64(y), np.uint64(x), channel]) + offset
                result[np.uint64(y), np.uint64(x), channel] = max(0, min(255, value))
