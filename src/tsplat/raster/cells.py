"""Which cells of a tile a splat touches, exactly: a tile is a grid of 4 by 4 cells, a cell 4 by 4 pixels.

What is drawn of a splat is an ellipse. In each row of cells it reaches farthest right where its
rightmost point is, or, when that lies in another row, at the edge towards it; the same on the left.
"""

from __future__ import annotations

import numpy as np

from tsplat._bits import add_spans
from tsplat._jit import part
from tsplat._lanes import load, maximum, minimum, splat, sqrt, store
from tsplat._moves import store_transposed
from tsplat.raster import record as col

TILE, CELL = 16, 4
"""Pixels of the side of a tile, and of a cell."""

GRID = TILE // CELL
CELLS = GRID * GRID

MARGIN = 1e-3
"""Pixels added to either end, and squared pixels to a half width squared: more than rounding can take away."""

SHAPES = 2 * 8 * col.LENGTH + 8
"""float32 values of the memory that `touch` needs: eight records row by row, then by column; then their cuts."""

COLUMNS = 8 * col.LENGTH
CUTS = 2 * COLUMNS

NEEDLE = 1e-9
"""The least that an ellipse narrows by, where rounding would leave nothing or less."""


@part
def touch(shapes, least_cut, drop, left, top, touched, at):
    """Find which cells of the tile at (left, top) eight records touch, member ``4 * row + column``.

    They lie in ``shapes``, row by row; the sets go into ``touched`` from ``at`` on. A splat is cut off at
    ``least_cut``, or ``drop`` below its peak where that is higher. All is counted in cells from side to side, in
    pixels from top to bottom. Of a row that is missed the ends are nan, and so nowhere.
    """
    store_transposed(shapes, COLUMNS, 8, shapes, 0, 8)
    zero, four, cells = splat(np.float32(0.0)), splat(np.float32(GRID)), splat(np.float32(1.0 / CELL))
    peak = load(shapes, COLUMNS + 8 * col.PEAK)
    cut = maximum(peak - splat(drop), splat(least_cut))
    store(shapes, CUTS, cut)
    # Beside X, at the height dy, it reaches from slope dy - h to slope dy + h, h^2 = half_width2 - narrowing dy^2.
    per_a = splat(np.float32(1.0)) / load(shapes, COLUMNS + 8 * col.CONIC_A)
    slope = splat(np.float32(-0.5)) * load(shapes, COLUMNS + 8 * col.CONIC_B) * per_a
    c_per_a = load(shapes, COLUMNS + 8 * col.CONIC_C) * per_a
    narrowing = maximum(c_per_a - slope * slope, splat(np.float32(NEEDLE)))
    half_width2 = (cut - peak) * per_a
    rightmost = slope * sqrt(half_width2 / (narrowing * c_per_a))
    leftmost = zero - rightmost
    x, y = load(shapes, COLUMNS + 8 * col.X), load(shapes, COLUMNS + 8 * col.Y) - splat(np.float32(top))
    # Rounded down, these and what is reached beyond them are how many cells are left out on either side.
    from_left = (x - splat(np.float32(left - 1 + MARGIN))) * cells
    from_right = (splat(np.float32(left + TILE - MARGIN)) - x) * cells
    slope, narrowing = slope * cells, narrowing * cells * cells
    half_width2 = (half_width2 + splat(np.float32(MARGIN))) * cells * cells
    for lane in range(8):
        touched[np.uint64(at + lane)] = 0
    for row in range(GRID):
        low = splat(np.float32(row * CELL)) - y
        high = low + splat(np.float32(CELL - 1))
        right_at, left_at = minimum(maximum(rightmost, low), high), minimum(maximum(leftmost, low), high)
        before = from_left + slope * left_at - sqrt(half_width2 - narrowing * left_at * left_at)
        after = from_right - slope * right_at - sqrt(half_width2 - narrowing * right_at * right_at)
        add_spans(touched, at, row, maximum(minimum(before, four), zero), maximum(minimum(after, four), zero))
