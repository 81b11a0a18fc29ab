"""Stage 4: blend the splats of each tile, nearest first.

Source: Kerbl et al. 2023, eq. 3 and section 6. A tile is 16 by 16 pixels in 4 by 2 cells of eight
lanes; a cell holds its transmittance, red, green, blue and depth side by side, so that blending a
splat into it touches two or three neighbouring cache lines and never leaves the first-level cache.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tsplat._jit import claim, kernel
from tsplat._lanes import (
    exp2,
    fma,
    largest,
    load,
    maximum,
    minimum,
    minus_abs,
    prefetch,
    splat,
    store,
    where_above,
    where_at_least,
)  # fmt: skip
from tsplat.raster import record as col
from tsplat.raster.sort import MAX_BUCKETS, into_buckets, sort_bucket
from tsplat.rendering import ALPHA_MAX, TRANSMITTANCE_MIN

F32 = npt.NDArray[np.float32]

TILE = 16
"""Pixels of a tile's side."""

CELL_WIDTH, CELL_HEIGHT = 4, 2
CELL_COLUMNS, CELL_ROWS = TILE // CELL_WIDTH, TILE // CELL_HEIGHT
"""A splat of a few pixels touches fewer 4 by 2 cells than rows of eight."""

CHANNELS = 5
CELL = CHANNELS * 8
"""float32 values of a cell: transmittance, red, green, blue, depth, eight lanes each."""

LANE_X = np.arange(8, dtype=np.float32) % CELL_WIDTH
LANE_Y = (np.arange(8) // CELL_WIDTH).astype(np.float32)

CHECK_EVERY = 32
"""Splats between two looks at whether a tile still lets light through."""


@kernel
def composite_tiles(worker, counter, tile_columns, isect_offsets, isect_keys, records, flat_records, background,
                    colors, alphas, depths):  # fmt: skip
    """Draw tiles until none is left; tiles own disjoint pixels, so workers never meet."""
    tile = np.empty(CELL_COLUMNS * CELL_ROWS * CELL, np.float32)
    most = 1
    for t in range(len(isect_offsets) - 1):
        most = max(most, isect_offsets[t + 1] - isect_offsets[t])
    keys = np.empty(most, np.uint64)
    bucket_ends = np.empty(MAX_BUCKETS + 1, np.int64)
    height, width = alphas.shape
    while True:
        t = claim(counter)
        if t >= len(isect_offsets) - 1:
            return
        left, top = t % tile_columns * TILE, t // tile_columns * TILE
        _clear(tile, width - left, height - top)
        first, end = isect_offsets[t], isect_offsets[t + 1]
        if end > first:
            buckets = into_buckets(isect_keys, first, end, keys, bucket_ends)
            _blend_buckets(tile, left, top, keys, bucket_ends, buckets, records, flat_records, depths)
        _write(tile, left, top, background, colors, alphas, depths)


@kernel
def _blend_buckets(tile, left, top, keys, bucket_ends, buckets, records, flat_records, depths):
    first, since_check = 0, 0
    for bucket in range(buckets):
        end = bucket_ends[bucket]
        sort_bucket(keys, first, end)
        for i in range(first, end):
            prefetch(flat_records, np.int64(keys[np.uint64(i)] & np.uint64(0xFFFFFFFF)) * col.LENGTH)
        for i in range(first, end):
            _blend(tile, left, top, records, keys[np.uint64(i)] & np.uint64(0xFFFFFFFF), depths)
        since_check += end - first
        if since_check >= CHECK_EVERY:
            since_check = 0
            if _most_light(tile) < np.float32(0.0):
                return
        first = end


@kernel
def _blend(tile, left, top, records, r, depths):
    """Blend one splat into the cells of a tile that its box touches."""
    first_column = max(np.int64(records[r, col.LEFT]) - left, 0) // CELL_WIDTH
    last_column = min(np.int64(records[r, col.RIGHT]) - left, TILE - 1) // CELL_WIDTH
    first_row = max(np.int64(records[r, col.TOP]) - top, 0) // CELL_HEIGHT
    last_row = min(np.int64(records[r, col.BOTTOM]) - top, TILE - 1) // CELL_HEIGHT
    a, b, c = splat(records[r, col.CONIC_A]), splat(records[r, col.CONIC_B]), splat(records[r, col.CONIC_C])
    log2_opacity, log2_cut = splat(records[r, col.LOG2_OPACITY]), splat(records[r, col.LOG2_CUT])
    red, green, blue, depth = (
        splat(records[r, col.RED]),
        splat(records[r, col.GREEN]),
        splat(records[r, col.BLUE]),
        splat(records[r, col.DEPTH]),
    )
    step_x, step_y = splat(np.float32(CELL_WIDTH)), splat(np.float32(CELL_HEIGHT))
    first_dx = load(LANE_X, 0) - splat(records[r, col.X] - np.float32(left + first_column * CELL_WIDTH))
    dy = load(LANE_Y, 0) - splat(records[r, col.Y] - np.float32(top + first_row * CELL_HEIGHT))
    columns = last_column - first_column + 1
    at = (first_row * CELL_COLUMNS + first_column) * CELL
    # A loop over the columns would mispredict its end once a row; this costs one misprediction a splat.
    for _ in range(first_row, last_row + 1):
        b_dy, constant = b * dy, fma(c * dy, dy, log2_opacity)
        dx = first_dx
        _blend_cell(tile, at, dx, a, b_dy, constant, log2_cut, red, green, blue, depth, depths)
        if columns > 1:
            dx = dx + step_x
            _blend_cell(tile, at + CELL, dx, a, b_dy, constant, log2_cut, red, green, blue, depth, depths)
        if columns > 2:
            dx = dx + step_x
            _blend_cell(tile, at + 2 * CELL, dx, a, b_dy, constant, log2_cut, red, green, blue, depth, depths)
        if columns > 3:
            dx = dx + step_x
            _blend_cell(tile, at + 3 * CELL, dx, a, b_dy, constant, log2_cut, red, green, blue, depth, depths)
        dy = dy + step_y
        at += CELL_COLUMNS * CELL


@kernel
def _blend_cell(tile, at, dx, a, b_dy, constant, log2_cut, red, green, blue, depth, depths):
    """Blend one splat into eight pixels."""
    log2_alpha = fma(fma(a, dx, b_dy), dx, constant)
    alpha = where_at_least(log2_alpha, log2_cut, minimum(exp2(log2_alpha), splat(np.float32(ALPHA_MAX))))
    light = load(tile, at)
    # A pixel is finished before the splat that would leave it too little light; its sign says so from then
    # on, and as what is left of a negative light is negative, nothing is blended into it any more.
    least, left_over = splat(np.float32(TRANSMITTANCE_MIN)), light - alpha * light
    weight = where_above(left_over, least, alpha * light, splat(np.float32(0.0)))
    store(tile, at, where_above(left_over, least, left_over, minus_abs(light)))
    store(tile, at + 8, fma(weight, red, load(tile, at + 8)))
    store(tile, at + 16, fma(weight, green, load(tile, at + 16)))
    store(tile, at + 24, fma(weight, blue, load(tile, at + 24)))
    if depths is not None:
        store(tile, at + 32, fma(weight, depth, load(tile, at + 32)))


@kernel
def _clear(tile, width, height):
    """Full light, no colour; pixels outside the image are finished, so that they never keep a tile open."""
    zero, full = splat(np.float32(0.0)), splat(np.float32(1.0))
    for at in range(0, len(tile), 8):
        store(tile, at, zero)
    for cell in range(CELL_COLUMNS * CELL_ROWS):
        x, y = cell % CELL_COLUMNS * CELL_WIDTH, cell // CELL_COLUMNS * CELL_HEIGHT
        if x + CELL_WIDTH <= width and y + CELL_HEIGHT <= height:
            store(tile, cell * CELL, full)
        else:
            for lane in range(8):
                inside = x + lane % CELL_WIDTH < width and y + lane // CELL_WIDTH < height
                tile[cell * CELL + lane] = np.float32(1.0 if inside else -1.0)


@kernel
def _most_light(tile):
    """Return the largest transmittance of a tile, negative when every pixel is finished."""
    most = load(tile, 0)
    for cell in range(1, CELL_COLUMNS * CELL_ROWS):
        most = maximum(most, load(tile, cell * CELL))
    return largest(most)


@kernel
def _write(tile, left, top, background, colors, alphas, depths):
    """Put a tile's pixels into the image, with the background behind them."""
    height, width = alphas.shape
    for row in range(min(TILE, height - top)):
        for column in range(min(TILE, width - left)):
            cell = row // CELL_HEIGHT * CELL_COLUMNS + column // CELL_WIDTH
            at = cell * CELL + row % CELL_HEIGHT * CELL_WIDTH + column % CELL_WIDTH
            x, y, light = left + column, top + row, abs(tile[at])
            for channel in range(3):
                colors[y, x, channel] = tile[at + 8 * (channel + 1)] + light * background[channel]
            alpha = np.float32(1.0) - light
            alphas[y, x] = alpha
            if depths is not None:
                depths[y, x] = tile[at + 32] / max(alpha, np.float32(1e-10))
