"""Stage 4: blend the splats of each tile, nearest first.

Source: Kerbl et al. 2023, eq. 3 and section 6. Splats are taken in batches of up to 64 records, each
with the set of cells it touches. A cell then blends its splats of the batch one after another with its
16 pixels in registers, and is left alone once all its pixels are finished.
"""

from __future__ import annotations

import numpy as np

from tsplat._bits import BATCH, count, having, lanes_at_least, lowest
from tsplat._jit import kernel
from tsplat._lanes import (
    exp2,
    fma,
    load,
    maximum,
    minimum,
    minus_abs,
    prefetch,
    splat,
    store,
    where_above,
    where_at_least,
)
from tsplat._threads import claim, meet
from tsplat.raster import record as col
from tsplat.raster import tile as channel
from tsplat.raster.cells import CELL, CELLS, GRID, TILE, cells_touched
from tsplat.raster.frame import NEXT_TILE
from tsplat.raster.tile import CELL_SIZE, TILE_SIZE, clear, write
from tsplat.rendering import ALPHA_MAX, TRANSMITTANCE_MIN

LANE_X = (np.arange(8) % CELL).astype(np.float32)
LANE_Y = (np.arange(8) // CELL).astype(np.float32)
"""Pixels of a vector: two rows of four."""

BLENDS = 0
"""Column of a worker's results: how many times it blended a splat into a cell."""

AHEAD = 16
"""Records asked for before they are used: about what the first-level cache can wait for at once."""


@kernel
def composite(worker, frame):
    """Draw tiles until none is left; tiles own disjoint pixels, so workers never meet before the end."""
    tile, batch = frame.scratch[worker, :TILE_SIZE], frame.scratch[worker, TILE_SIZE:]
    touched, depths = frame.touched[worker], frame.depths
    isect_ends = frame.tile_cursors[frame.workers - 1]
    blends = 0
    while True:
        t = claim(frame.team, NEXT_TILE)
        if t >= frame.tile_count:
            frame.results[worker, BLENDS] = blends
            return meet(frame.team, frame.workers)
        left, top = t % frame.tile_columns * TILE, t // frame.tile_columns * TILE
        live = clear(tile, frame.width - left, frame.height - top)
        next_, end = (isect_ends[t - 1] if t > 0 else 0), isect_ends[t]
        while next_ < end and live != 0:
            next_ = _fill_batch(frame.isect_ids, next_, end, frame.records, left, top, live, batch, touched)
            for cell in range(CELLS):
                if live >> cell & 1:
                    splats = having(touched, cell)
                    blends += count(splats)
                    x, y = left + cell % GRID * CELL, top + cell // GRID * CELL
                    if _blend(tile, cell * CELL_SIZE, x, y, batch, splats, depths):
                        live &= ~(1 << cell)
        write(tile, left, top, frame.background, frame.colors, frame.alphas, depths)


@kernel
def _fill_batch(isect_ids, next_, end, records, left, top, live, batch, touched):
    """Copy the records of the next splats that touch a live cell, with these cells; return which comes after."""
    x, y = np.float32(left), np.float32(top)
    members = 0
    while next_ < end and members < BATCH:
        prefetch(records, np.int64(isect_ids[np.uint64(next_ + AHEAD)]) * col.LENGTH)
        at = np.int64(isect_ids[np.uint64(next_)]) * col.LENGTH
        cells = cells_touched(records, at, x, y) & live
        store(batch, members * col.LENGTH, load(records, at))
        store(batch, members * col.LENGTH + 8, load(records, at + 8))
        touched[np.uint64(members)] = cells
        members += 1 if cells != 0 else 0  # what touches nothing is overwritten
        next_ += 1
    touched[members:] = 0
    return next_


@kernel
def _blend(tile, at, left, top, batch, splats, depths):
    """Blend members of a batch into the cell at ``at``; return whether all its pixels are finished."""
    x, y = load(LANE_X, 0) + splat(np.float32(left)), load(LANE_Y, 0) + splat(np.float32(top))
    light0, light1 = load(tile, at + channel.LIGHT), load(tile, at + channel.LIGHT + 8)
    red0, red1 = load(tile, at + channel.RED), load(tile, at + channel.RED + 8)
    green0, green1 = load(tile, at + channel.GREEN), load(tile, at + channel.GREEN + 8)
    blue0, blue1 = load(tile, at + channel.BLUE), load(tile, at + channel.BLUE + 8)
    if depths is not None:
        depth0, depth1 = load(tile, at + channel.DEPTH), load(tile, at + channel.DEPTH + 8)
    while splats != np.uint64(0):
        r = lowest(splats) * col.LENGTH
        splats &= splats - np.uint64(1)
        dx, dy = _value(batch, r + col.X) - x, _value(batch, r + col.Y) - y
        b_dx, c = _value(batch, r + col.CONIC_B) * dx, _value(batch, r + col.CONIC_C)
        a_dx2 = fma(_value(batch, r + col.CONIC_A) * dx, dx, _value(batch, r + col.LOG2_OPACITY))
        cut = _value(batch, r + col.LOG2_CUT)
        light0, weight0 = _absorb(light0, fma(fma(c, dy, b_dx), dy, a_dx2), cut)
        dy = dy - splat(np.float32(2.0))
        light1, weight1 = _absorb(light1, fma(fma(c, dy, b_dx), dy, a_dx2), cut)
        red = _value(batch, r + col.RED)
        red0, red1 = fma(weight0, red, red0), fma(weight1, red, red1)
        green = _value(batch, r + col.GREEN)
        green0, green1 = fma(weight0, green, green0), fma(weight1, green, green1)
        blue = _value(batch, r + col.BLUE)
        blue0, blue1 = fma(weight0, blue, blue0), fma(weight1, blue, blue1)
        if depths is not None:
            depth = _value(batch, r + col.DEPTH)
            depth0, depth1 = fma(weight0, depth, depth0), fma(weight1, depth, depth1)
    store(tile, at + channel.LIGHT, light0)
    store(tile, at + channel.LIGHT + 8, light1)
    store(tile, at + channel.RED, red0)
    store(tile, at + channel.RED + 8, red1)
    store(tile, at + channel.GREEN, green0)
    store(tile, at + channel.GREEN + 8, green1)
    store(tile, at + channel.BLUE, blue0)
    store(tile, at + channel.BLUE + 8, blue1)
    if depths is not None:
        store(tile, at + channel.DEPTH, depth0)
        store(tile, at + channel.DEPTH + 8, depth1)
    return lanes_at_least(maximum(light0, light1), splat(np.float32(0.0))) == 0


@kernel
def _value(batch, at):
    return splat(batch[np.uint64(at)])


@kernel
def _absorb(light, log2_alpha, cut):
    """Return the light behind a splat, and the weight of its colour.

    A pixel is finished before the splat that would leave it too little light. Its sign says so from then
    on: as what is left of a negative light is negative, nothing is blended into it any more.
    """
    alpha = where_at_least(log2_alpha, cut, minimum(exp2(log2_alpha), splat(np.float32(ALPHA_MAX))))
    weight = alpha * light
    left_over, least = light - weight, splat(np.float32(TRANSMITTANCE_MIN))
    weight = where_above(left_over, least, weight, splat(np.float32(0.0)))
    return where_above(left_over, least, left_over, minus_abs(light)), weight
