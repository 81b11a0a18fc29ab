"""Stage 3: which splats touch which tile: count, scan, scatter, by depth, so that each tile's list is sorted.

Each worker has a part of the splats that costs as much as any other's, which need not be as many: from inside of a
scene the nearest few touch most tiles.
"""

from __future__ import annotations

import numpy as np

from tsplat._jit import part
from tsplat._moves import prefetch
from tsplat._threads import meet
from tsplat.raster.frame import SLACK, VISIBLE
from tsplat.raster.sort import scan, stretch

AHEAD = 4
"""Places of a tile's list asked for before they are filled: lists are more than there are streams of stores that a
processor follows by itself. No more, as each list would hold two lines of the caches in place of one."""

SAMPLES = 1024
"""Splats that are looked at to find out where most of the work is."""

SPLAT_COST = 2
"""Pairs that take as long as a splat does beside its pairs."""


@part
def bin_tiles(worker, frame):
    """Fill ``isect_ids``, the records of each tile by depth; a tile's end where the last worker's cursor does.

    Return how many pairs of a tile and a splat there are, or -1 when the team was abandoned. When they are
    more than ``isect_ids`` has room for, nothing is filled.
    """
    counts, cursors = frame.tile_counts[worker], frame.tile_cursors[worker]
    first, end = _share(worker, frame.workers, frame.results[worker, VISIBLE], frame.order, frame.tiles)
    _gather_tiles(first, end, frame.order, frame.tiles, frame.sorted_tiles)
    _count(first, end, frame.tile_columns, frame.sorted_tiles, frame.tile_steps[worker], counts)
    if not meet(frame.team, frame.workers):
        return -1
    pairs = scan(worker, frame.tile_counts, frame.first_tile, frame.end_tile, cursors)
    if pairs <= room(frame):
        _scatter(first, end, frame.tile_columns, frame.order, frame.sorted_tiles, cursors, frame.isect_ids)
        frame.isect_ids[pairs : pairs + SLACK] = 0
    return pairs if meet(frame.team, frame.workers) else -1


@part
def room(frame):
    """Return how many pairs ``isect_ids`` may hold; a little more of it is read ahead."""
    return len(frame.isect_ids) - SLACK


@part
def _share(worker, workers, visible, order, tiles):
    """Return a worker's first splat and the one after its last, so that all workers have about as much to do."""
    samples = min(visible, SAMPLES)
    total = 0
    for sample in range(samples):
        total += _cost(sample, samples, visible, order, tiles)
    low, high = stretch(worker, workers, total)
    first, end, done = 0, 0, 0
    for sample in range(samples):
        first += done < low
        end += done < high
        done += _cost(sample, samples, visible, order, tiles)
    return first * visible // max(samples, 1), end * visible // max(samples, 1)


@part
def _cost(sample, samples, visible, order, tiles):
    splat = order[np.uint64(sample * visible // samples)]
    left, top, right, bottom = _corners(tiles[np.uint64(splat)])
    return SPLAT_COST + (right - left + 1) * (bottom - top + 1)


@part
def _gather_tiles(first, end, order, tiles, sorted_tiles):
    # A loop of its own: with nothing else to wait for, many of these far loads are under way at once.
    for i in range(first, end):
        sorted_tiles[np.uint64(i)] = tiles[np.uint64(order[np.uint64(i)])]


@part
def _count(first, end, tile_columns, sorted_tiles, steps, counts):
    """Count the splats of each tile: each is four steps at its corners, and a tile has the sum of those before it.

    So no branch can be mispredicted. ``steps`` has a row and a column more than there are tiles.
    """
    steps[:] = 0
    wide = tile_columns + 1
    for i in range(first, end):
        left, top, right, bottom = _corners(sorted_tiles[np.uint64(i)])
        upper, lower = top * wide, (bottom + 1) * wide
        steps[np.uint64(upper + left)] += 1
        steps[np.uint64(upper + right + 1)] -= 1
        steps[np.uint64(lower + left)] -= 1
        steps[np.uint64(lower + right + 1)] += 1
    for row in range(len(counts) // tile_columns):
        total = 0
        for column in range(tile_columns):
            total += steps[np.uint64(row * wide + column)]
            above = counts[np.uint64((row - 1) * tile_columns + column)] if row > 0 else 0
            counts[np.uint64(row * tile_columns + column)] = total + above


@part
def _scatter(first, end, tile_columns, order, sorted_tiles, cursors, isect_ids):
    for i in range(first, end):
        record = order[np.uint64(i)]
        left, top, right, bottom = _corners(sorted_tiles[np.uint64(i)])
        tile, column, wide = top * tile_columns + left, 0, right - left + 1
        # One loop over rows and columns: only its end can be mispredicted, not that of every row as well.
        for _ in range(wide * (bottom - top + 1)):
            t = np.uint64(tile)
            isect_ids[np.uint64(cursors[t])] = record
            prefetch(isect_ids, cursors[t] + AHEAD)
            cursors[t] += 1
            column += 1
            row_ends = column == wide
            tile += tile_columns - wide + 1 if row_ends else 1
            column = 0 if row_ends else column


@part
def _corners(tiles):
    """Unpack the first and last tile column and row: left, top, right, bottom."""
    ones = np.uint64(0xFFFF)
    return (
        np.int64(tiles & ones),
        np.int64(tiles >> np.uint64(16) & ones),
        np.int64(tiles >> np.uint64(32) & ones),
        np.int64(tiles >> np.uint64(48)),
    )
