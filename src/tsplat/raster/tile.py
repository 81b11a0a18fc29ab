"""The memory of one tile while it is drawn: cells of 4 by 4 pixels, each channel of a cell side by side.

A cell holds transmittance, red, green, blue and depth, two vectors of eight lanes each: the upper
two rows of four pixels, then the lower two. It stays in the first-level cache from clear to write.
"""

from __future__ import annotations

import numpy as np

from tsplat._jit import part
from tsplat._lanes import load, maximum, minus_abs, splat, store
from tsplat._moves import store_rows, store_rows_rgb
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
    width, height = image.width, image.height
    for cell in range(CELLS):
        x, y, at = left + cell % GRID * CELL, top + cell // GRID * CELL, cell * CELL_SIZE
        if x + CELL <= width and y + CELL <= height:
            _write_rows(tile, at, y * width + x, image, depths)
            _write_rows(tile, at + 8, (y + 2) * width + x, image, depths)
        else:
            for row in range(y, min(y + CELL, height)):
                for column in range(x, min(x + CELL, width)):
                    _write_pixel(tile, at + (row - y) * CELL + column - x, row * width + column, image, depths)


@part
def write_background(tile, left, top, image, depths):
    """Put the background into the pixels of a tile that no splat touches; the tile's memory is overwritten."""
    for value in range(24):
        tile[value] = image.background[value % 3]
    pixels1, pixels2, pixels3, zero = load(tile, 0), load(tile, 8), load(tile, 16), splat(np.float32(0.0))
    for y in range(top, min(top + TILE, image.height)):
        right = min(left + TILE, image.width)
        for x in range(left, right - 7, 8):
            pixel = y * image.width + x
            store(image.colors, 3 * pixel, pixels1)
            store(image.colors, 3 * pixel + 8, pixels2)
            store(image.colors, 3 * pixel + 16, pixels3)
            store(image.alphas, pixel, zero)
            if depths is not None:
                store(depths, pixel, zero)
        for x in range(right - (right - left) % 8, right):
            pixel = y * image.width + x
            for channel in range(3):
                image.colors[3 * pixel + channel] = image.background[channel]
            image.alphas[pixel] = 0.0
            if depths is not None:
                depths[pixel] = 0.0


@part
def _write_rows(tile, at, pixel, image, depths):
    """Write two rows of four pixels, from ``pixel`` and one row below it on."""
    below, background = pixel + image.width, image.background
    zero, one = splat(np.float32(0.0)), splat(np.float32(1.0))
    light = zero - minus_abs(load(tile, at + LIGHT))
    red = load(tile, at + RED) + light * splat(background[0])
    green = load(tile, at + GREEN) + light * splat(background[1])
    blue = load(tile, at + BLUE) + light * splat(background[2])
    store_rows_rgb(image.colors, 3 * pixel, 3 * below, red, green, blue)
    alpha = one - light
    store_rows(image.alphas, pixel, below, alpha)
    if depths is not None:
        store_rows(depths, pixel, below, load(tile, at + DEPTH) / maximum(alpha, splat(np.float32(1e-10))))


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
