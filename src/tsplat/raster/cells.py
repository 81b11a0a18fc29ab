"""Which cells of a tile a splat touches, exactly: a tile is a grid of 4 by 4 cells, a cell 4 by 4 pixels.

What is drawn of a splat is an ellipse. In each row of cells it reaches farthest right where its
rightmost point is, or, when that lies in another row, at the edge towards it; the same on the left.
"""

from __future__ import annotations

import numpy as np

from tsplat._bits import add_spans
from tsplat._jit import part
from tsplat._lanes import load, maximum, minimum, splat, sqrt
from tsplat._moves import store_transposed
from tsplat.raster import record as col

TILE, CELL = 16, 4
"""Pixels of the side of a tile, and of a cell."""

GRID = TILE // CELL
CELLS = GRID * GRID

MARGIN = 1e-3
"""Pixels added to either end, and squared pixels to a half width squared: more than rounding can take away."""

SHAPES = 2 * 8 * 8
"""float32 values of the memory that `touch` needs: the first halves of eight records, row by row, then by column."""

COLUMNS = 8 * 8


@part
def touch(shapes, left, top, touched, at):
    """Find which cells of the tile at (left, top) eight records touch, member ``4 * row + column``.

    Their first halves lie in ``shapes``, row by row; the sets go into ``touched`` from ``at`` on. All is counted in
    cells from side to side, in pixels from top to bottom. Of a row that is missed the ends are nan, and so nowhere.
    """
    store_transposed(shapes, COLUMNS, 8, shapes, 0, 8)
    zero, four, cells = splat(np.float32(0.0)), splat(np.float32(GRID)), splat(np.float32(1.0 / CELL))
    x, y = load(shapes, COLUMNS + 8 * col.X), load(shapes, COLUMNS + 8 * col.Y) - splat(np.float32(top))
    # Rounded down, these and what is reached beyond them are how many cells are left out on either side.
    from_left = (x - splat(np.float32(left - 1 + MARGIN))) * cells
    from_right = (splat(np.float32(left + TILE - MARGIN)) - x) * cells
    slope = load(shapes, COLUMNS + 8 * col.SLOPE) * cells
    half_width2 = (load(shapes, COLUMNS + 8 * col.HALF_WIDTH2) + splat(np.float32(MARGIN))) * cells * cells
    narrowing = load(shapes, COLUMNS + 8 * col.NARROWING) * cells * cells
    rightmost = load(shapes, COLUMNS + 8 * col.RIGHTMOST)
    leftmost = zero - rightmost
    for lane in range(8):
        touched[np.uint64(at + lane)] = 0
    for row in range(GRID):
        low = splat(np.float32(row * CELL)) - y
        high = low + splat(np.float32(CELL - 1))
        right_at, left_at = minimum(maximum(rightmost, low), high), minimum(maximum(leftmost, low), high)
        before = from_left + slope * left_at - sqrt(half_width2 - narrowing * left_at * left_at)
        after = from_right - slope * right_at - sqrt(half_width2 - narrowing * right_at * right_at)
        add_spans(touched, at, row, maximum(minimum(before, four), zero), maximum(minimum(after, four), zero))
