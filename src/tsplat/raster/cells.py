"""Which cells of a tile a splat touches, exactly: a tile is a grid of 4 by 4 cells, a cell 4 by 4 pixels.

What is drawn of a splat is an ellipse. In each row of cells it reaches farthest right where its
rightmost point is, or, when that lies in another row, at the edge towards it; the same on the left.
"""

from __future__ import annotations

import numpy as np

from tsplat._bits import spans
from tsplat._jit import part
from tsplat._lanes import fma, load, maximum, minimum, splat, sqrt, where_above
from tsplat.raster import record as col

TILE, CELL = 16, 4
"""Pixels of the side of a tile, and of a cell."""

GRID = TILE // CELL
CELLS = GRID * GRID

# Lanes 0 to 3 find the right ends of the four rows of cells, lanes 4 to 7 the left ends, mirrored.
ROW_TOP = np.tile(np.arange(GRID, dtype=np.float32) * CELL, 2)
SIDE = np.repeat(np.asarray([1.0, -1.0], np.float32), GRID)
LOWEST_END = np.repeat(np.asarray([-1.0, -GRID], np.float32), GRID)
HIGHEST_END = np.repeat(np.asarray([GRID - 1.0, 0.0], np.float32), GRID)
"""A row ends at a column; on the left columns are mirrored, and so negative. See `_bits.spans`."""

MARGIN = 1e-3
"""Pixels added to either end, more than rounding can take away."""

BEYOND = np.repeat(np.asarray([MARGIN, CELL - 1.0 + MARGIN], np.float32), GRID)
"""Added to an end, makes rounding down find the last column whose pixels are reached, on the left as well."""


@part
def cells_touched(records, at, left, top):
    """Return which cells of the tile at (left, top) a record touches, member ``4 * row + column``."""
    rightmost, side, zero = splat(records[at + col.RIGHTMOST]), load(SIDE, 0), splat(np.float32(0.0))
    low = load(ROW_TOP, 0) - splat(records[at + col.Y] - top)
    high = low + splat(np.float32(CELL - 1))
    y = minimum(maximum(side * rightmost, low), high)
    half_width2 = splat(records[at + col.HALF_WIDTH2]) - splat(records[at + col.NARROWING]) * y * y
    middle = fma(splat(records[at + col.SLOPE]), y, splat(records[at + col.X] - left))
    reach = fma(side, middle, sqrt(maximum(half_width2, zero)) + load(BEYOND, 0))
    ends = reach * splat(np.float32(1.0 / CELL))
    ends = where_above(half_width2, splat(np.float32(-MARGIN)), ends, splat(np.float32(-GRID)))
    return spans(minimum(maximum(ends, load(LOWEST_END, 0)), load(HIGHEST_END, 0)))
