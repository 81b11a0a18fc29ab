"""The memory of one tile while it is drawn: cells of 4 by 4 pixels, each channel of a cell side by side.

A cell holds transmittance, red, green, blue and depth, two vectors of eight lanes each: the upper
two rows of four pixels, then the lower two. It stays in the first-level cache from clear to write.
"""

from __future__ import annotations

import numpy as np

from tsplat._jit import part
from tsplat._lanes import load, maximum, minus_abs, splat, store
from tsplat._moves import first_halves, interleaved, second_halves, store_past_caches
from tsplat.raster.cells import CELL, CELLS, GRID, TILE

LIGHT, RED, GREEN, BLUE, DEPTH = 0, 16, 32, 48, 64
"""Where the channels of a cell begin, in float32 values. The light of a finished pixel is negative."""

CELL_SIZE = 80
TILE_SIZE = CELLS * CELL_SIZE


@part
def clear(tile, width, height):
    """Full light, no colour; pixels outside the image are finished. Return the cells that have others."""
    zero, full = splat(np.float32(0.0)), splat(np.float32(1.0))
    live = 0
    for cell in range(CELLS):
        x, y, at = cell % GRID * CELL, cell // GRID * CELL, cell * CELL_SIZE
        for channel in range(at + RED, at + CELL_SIZE, 8):
            store(tile, channel, zero)
        live |= (1 if x < width and y < height else 0) << cell
        if x + CELL <= width and y + CELL <= height:
            store(tile, at, full)
            store(tile, at + 8, full)
        else:
            for pixel in range(CELL * CELL):
                inside = x + pixel % CELL < width and y + pixel // CELL < height
                tile[at + pixel] = np.float32(1.0 if inside else -1.0)
    return live


@part
def write(tile, left, top, image, depths):
    """Put a tile's pixels into the image, with the background behind them."""
    right, bottom = min(left + TILE, image.width), min(top + TILE, image.height)
    if right == left + TILE and bottom == top + TILE:
        for cell in range(0, CELLS, 2):
            pixel = (top + cell // GRID * CELL) * image.width + left + cell % GRID * CELL
            _write_rows(tile, cell * CELL_SIZE, pixel, image, depths)
            _write_rows(tile, cell * CELL_SIZE + 8, pixel + 2 * image.width, image, depths)
    else:
        for y in range(bottom - top):
            for x in range(right - left):
                at = (y // CELL * GRID + x // CELL) * CELL_SIZE + y % CELL * CELL + x % CELL
                _write_pixel(tile, at, (top + y) * image.width + left + x, image, depths)


@part
def write_background(tile, left, top, image, depths):
    """Put the background into the pixels of a tile that no splat touches; the tile's memory is overwritten."""
    for value in range(24):
        tile[value] = image.background[value % 3]
    colors, zero = (load(tile, 0), load(tile, 8), load(tile, 16)), splat(np.float32(0.0))
    right, bottom = min(left + TILE, image.width), min(top + TILE, image.height)
    for y in range(top, bottom):
        for x in range(left, right - 7, 8):
            _write_eight(y * image.width + x, colors, zero, zero, image, depths)
        for x in range(right - (right - left) % 8, right):
            pixel = y * image.width + x
            for channel in range(3):
                image.colors[3 * pixel + channel] = image.background[channel]
            image.alphas[pixel] = 0.0
            if depths is not None:
                depths[pixel] = 0.0


@part
def _write_rows(tile, at, pixel, image, depths):
    """Write two rows of two cells side by side, from ``pixel`` and one row below it on."""
    red1, green1, blue1, alpha1, depth1 = _pixels(tile, at, image.background)
    red2, green2, blue2, alpha2, depth2 = _pixels(tile, at + CELL_SIZE, image.background)
    colors = interleaved(first_halves(red1, red2), first_halves(green1, green2), first_halves(blue1, blue2))
    alpha, depth = first_halves(alpha1, alpha2), first_halves(depth1, depth2)
    _write_eight(pixel, colors, alpha, depth, image, depths)
    colors = interleaved(second_halves(red1, red2), second_halves(green1, green2), second_halves(blue1, blue2))
    alpha, depth = second_halves(alpha1, alpha2), second_halves(depth1, depth2)
    _write_eight(pixel + image.width, colors, alpha, depth, image, depths)


@part
def _pixels(tile, at, background):
    """Return red, green, blue, alpha and depth of two rows of a cell, over the background."""
    light = splat(np.float32(0.0)) - minus_abs(load(tile, at + LIGHT))
    red = load(tile, at + RED) + light * splat(background[0])
    green = load(tile, at + GREEN) + light * splat(background[1])
    blue = load(tile, at + BLUE) + light * splat(background[2])
    alpha = splat(np.float32(1.0)) - light
    return red, green, blue, alpha, load(tile, at + DEPTH) / maximum(alpha, splat(np.float32(1e-10)))


@part
def _write_eight(pixel, colors, alpha, depth, image, depths):
    """Write eight pixels side by side."""
    for third in range(3):
        _store(image.colors, 3 * pixel + 8 * third, colors[third], image.past_caches)
    _store(image.alphas, pixel, alpha, image.past_caches)
    if depths is not None:
        _store(depths, pixel, depth, image.past_caches)


@part
def _store(array, at, value, past_caches):
    if past_caches:
        store_past_caches(array, at, value)
    else:
        store(array, at, value)


@part
def _write_pixel(tile, at, pixel, image, depths):
    light, background = abs(tile[at + LIGHT]), image.background
    image.colors[3 * pixel] = tile[at + RED] + light * background[0]
    image.colors[3 * pixel + 1] = tile[at + GREEN] + light * background[1]
    image.colors[3 * pixel + 2] = tile[at + BLUE] + light * background[2]
    alpha = np.float32(1.0) - light
    image.alphas[pixel] = alpha
    if depths is not None:
        depths[pixel] = tile[at + DEPTH] / max(alpha, np.float32(1e-10))
