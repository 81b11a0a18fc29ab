"""Stage 4: blend the splats of each tile, nearest first.

Source: Kerbl et al. 2023, eq. 3 and section 6. Splats are taken in batches of up to 64 records, each
with the set of cells it touches, from which follow the splats of each cell. A cell then blends its splats
of the batch, and is left alone once all its pixels are finished.
"""

from __future__ import annotations

import numpy as np

from tsplat._bits import BATCH, count, lanes_at_least, lowest, others, transpose_sets
from tsplat._jit import part
from tsplat._lanes import fma, load, maximum, minimum, minus_abs, splat, store, where_above, where_at_least
from tsplat._moves import load_half, prefetch
from tsplat._threads import meet, take
from tsplat.raster import member as col
from tsplat.raster import record as packed
from tsplat.raster import tile as channel
from tsplat.raster.cells import CELL, CELLS, CUTS, GRID, SHAPES, TILE, touch
from tsplat.raster.falloff import LOG2_E, OFFSET, SCALE, alpha_of
from tsplat.raster.frame import BLENDS, KEY_SHIFT, NEXT_TILE
from tsplat.raster.tile import CELL_SIZE, TILE_SIZE, clear, write, write_background
from tsplat.rendering import ALPHA_MAX, TRANSMITTANCE_MIN

LANE_X = (np.arange(8) % CELL).astype(np.float32)
LANE_Y = (np.arange(8) // CELL).astype(np.float32)
"""Pixels of a vector: two rows of four."""

NOBODY = BATCH * col.LENGTH

AHEAD = 48
"""Records asked for before they are used: those of the next batch come while one is blended."""


@part
def composite(worker, frame):
    """Draw tiles until none is left; tiles own disjoint pixels, so workers never meet before the end."""
    tile, behind = frame.scratch[worker, :TILE_SIZE], frame.scratch[worker, TILE_SIZE:]
    shapes, batch = behind[:SHAPES], behind[SHAPES:]
    touched, touching, depths = frame.touched[worker], frame.touching[worker], frame.image.depths
    isect_ends = frame.tile_cursors[frame.workers - 1]
    # Behind the last member, one that is never seen completes the threes.
    batch[NOBODY : NOBODY + col.LENGTH] = 0.0
    batch[NOBODY + col.CUT] = np.inf
    first, tiles = frame.first_tile, frame.end_tile - frame.first_tile
    blends, taken, behind = 0, -1, 0
    while True:
        taken += 1
        if taken == behind:
            taken, behind = take(frame.team, NEXT_TILE, tiles, 1, frame.workers)
        if taken == tiles:
            frame.results[worker, BLENDS] = blends
            return meet(frame.team, frame.workers)
        t = first + taken
        left, top = t % frame.tile_columns * TILE, t // frame.tile_columns * TILE
        next_, end = (isect_ends[t - 1] if taken > 0 else 0), isect_ends[t]
        if next_ == end:
            write_background(tile, left, top, frame.image, depths)
            continue
        live = clear(tile, frame.image.width - left, frame.image.height - top)
        while next_ < end and live != 0:
            next_ = _fill_batch(frame, next_, end, left, top, live, batch, shapes, touched, depths)
            transpose_sets(touched, touching)
            for cell in range(CELLS):
                splats = touching[np.uint64(cell)]
                if splats != np.uint64(0):
                    blends += count(splats)
                    x, y = left + cell % GRID * CELL, top + cell // GRID * CELL
                    if blend_cell(tile, cell * CELL_SIZE, x, y, batch, splats, depths):
                        live &= ~(1 << cell)
        write(tile, left, top, frame.image, depths)


@part
def _fill_batch(frame, next_, end, left, top, live, batch, shapes, touched, depths):
    """Unpack the next splats that touch a live cell, with these cells; return which comes after."""
    isect_ids, records, halves = frame.isect_ids, frame.records, frame.halves
    log2_alpha_min, squared_extent = frame.numbers[24:26]
    least_cut = np.float32(SCALE) * log2_alpha_min + np.float32(OFFSET)
    drop = np.float32(SCALE * 0.5 * LOG2_E) * squared_extent
    members = 0
    while next_ < end and members <= BATCH - 8:
        for lane in range(8):
            prefetch(records, _record(isect_ids, next_ + AHEAD + lane) * packed.LENGTH)
            store(shapes, lane * packed.LENGTH, load(records, _record(isect_ids, next_ + lane) * packed.LENGTH))
        touch(shapes, least_cut, drop, left, top, touched, members)
        found = members
        for lane in range(min(8, end - next_)):
            record, member = _record(isect_ids, next_ + lane), members * col.LENGTH
            cells = touched[np.uint64(found + lane)] & live
            store(batch, member, load(records, record * packed.LENGTH))
            store(batch, member + col.UNPACKED, load_half(halves, (2 * record + 1) * packed.LENGTH))
            batch[np.uint64(member + col.CUT)] = shapes[np.uint64(CUTS + lane)]
            if depths is not None:
                batch[np.uint64(member + col.DEPTH)] = _depth(
                    frame.depth_keys[np.uint64(record)], frame.nearest_key
                )
            touched[np.uint64(members)] = cells
            members += 1 if cells != 0 else 0  # what touches nothing is overwritten
        next_ += 8
    touched[members:] = 0
    return min(next_, end)


@part
def _record(isect_ids, i):
    return np.int64(isect_ids[np.uint64(i)])


@part
def _depth(key, nearest_key):
    """Return the depth that has this key: what the key lacks of it is less than float32 holds."""
    bits = (np.uint64(key) + np.uint64(nearest_key)) << np.uint64(KEY_SHIFT)
    return np.float32(np.uint64(bits).view(np.float64))


@part
def blend_cell(tile, at, left, top, batch, splats, depths):
    """Blend members of a batch into the cell at ``at``; return whether all its pixels are finished.

    Three are taken at a time. Most of the work is a long chain of operations from a record to its alphas, and
    what keeps the processor busy is that the chains of three splats have nothing to wait for in each other.
    """
    x, y = load(LANE_X, 0) + splat(np.float32(left)), load(LANE_Y, 0) + splat(np.float32(top))
    while splats != np.uint64(0):
        first = lowest(splats) * col.LENGTH
        splats = others(splats)
        second = lowest(splats) * col.LENGTH
        splats = others(splats)
        third = lowest(splats) * col.LENGTH
        splats = others(splats)
        upper1, lower1 = _alphas(batch, first, x, y)
        upper2, lower2 = _alphas(batch, second, x, y)
        upper3, lower3 = _alphas(batch, third, x, y)
        upper = _absorb_three(tile, at + channel.LIGHT, upper1, upper2, upper3)
        lower = _absorb_three(tile, at + channel.LIGHT + 8, lower1, lower2, lower3)
        _add_three(tile, at + channel.RED, upper, lower, batch, first, second, third, col.RED)
        _add_three(tile, at + channel.GREEN, upper, lower, batch, first, second, third, col.GREEN)
        _add_three(tile, at + channel.BLUE, upper, lower, batch, first, second, third, col.BLUE)
        if depths is not None:
            _add_three(tile, at + channel.DEPTH, upper, lower, batch, first, second, third, col.DEPTH)
    most = maximum(load(tile, at + channel.LIGHT), load(tile, at + channel.LIGHT + 8))
    return lanes_at_least(most, splat(np.float32(0.0))) == 0


@part
def _alphas(batch, member, x, y):
    """Return the alphas of a member of the batch in the upper and the lower eight pixels of a cell."""
    dx, dy = _value(batch, member + col.X) - x, _value(batch, member + col.Y) - y
    b_dx, c = _value(batch, member + col.CONIC_B) * dx, _value(batch, member + col.CONIC_C)
    a_dx2 = fma(_value(batch, member + col.CONIC_A) * dx, dx, _value(batch, member + col.PEAK))
    upper = fma(fma(c, dy, b_dx), dy, a_dx2)
    dy = dy - splat(np.float32(2.0))
    lower = fma(fma(c, dy, b_dx), dy, a_dx2)
    cut, most = _value(batch, member + col.CUT), splat(np.float32(ALPHA_MAX))
    return (
        where_at_least(upper, cut, minimum(alpha_of(upper), most)),
        where_at_least(lower, cut, minimum(alpha_of(lower), most)),
    )


@part
def _value(batch, at):
    return splat(batch[np.uint64(at)])


@part
def _absorb_three(tile, at, alpha1, alpha2, alpha3):
    """Take the light that three splats absorb, one behind the other; return the weights of their colours."""
    light = load(tile, at)
    light, weight1 = _absorb(light, alpha1)
    light, weight2 = _absorb(light, alpha2)
    light, weight3 = _absorb(light, alpha3)
    store(tile, at, light)
    return weight1, weight2, weight3


@part
def _absorb(light, alpha):
    """Return the light behind a splat, and the weight of its colour.

    A pixel is finished before the splat that would leave it too little light. Its sign says so from then
    on: as what is left of a negative light is negative, nothing is blended into it any more.
    """
    weight = alpha * light
    left_over, least = light - weight, splat(np.float32(TRANSMITTANCE_MIN))
    weight = where_above(left_over, least, weight, splat(np.float32(0.0)))
    return where_above(left_over, least, left_over, minus_abs(light)), weight


@part
def _add_three(tile, at, upper, lower, batch, first, second, third, column):
    """Add a column of three members, by weight, to a channel of a cell."""
    value1, value2 = _value(batch, first + column), _value(batch, second + column)
    value3 = _value(batch, third + column)
    store(tile, at, fma(upper[2], value3, fma(upper[1], value2, fma(upper[0], value1, load(tile, at)))))
    store(tile, at + 8, fma(lower[2], value3, fma(lower[1], value2, fma(lower[0], value1, load(tile, at + 8)))))
