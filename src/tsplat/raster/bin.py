"""Stage 3: which splats touch which tile: count, scan, scatter, by depth, so that each tile's list is sorted."""

from __future__ import annotations

import numpy as np

from tsplat._jit import part
from tsplat._threads import meet
from tsplat.raster.frame import SLACK, VISIBLE
from tsplat.raster.sort import scan, stretch


@part
def bin_tiles(worker, frame):
    """Fill ``isect_ids``, the records of each tile by depth; a tile's end where the last worker's cursor does.

    Return how many pairs of a tile and a splat there are, or -1 when the team was abandoned. When they are
    more than ``isect_ids`` has room for, nothing is filled.
    """
    counts, cursors = frame.tile_counts[worker], frame.tile_cursors[worker]
    first, end = stretch(worker, frame.workers, frame.results[worker, VISIBLE])
    _gather_tiles(first, end, frame.order, frame.tiles, frame.sorted_tiles)
    _count(first, end, frame.tile_columns, frame.sorted_tiles, counts)
    if not meet(frame.team, frame.workers):
        return -1
    pairs = scan(worker, frame.tile_counts, 0, frame.tile_count, cursors)
    if pairs <= room(frame):
        _scatter(first, end, frame.tile_columns, frame.order, frame.sorted_tiles, cursors, frame.isect_ids)
        frame.isect_ids[pairs : pairs + SLACK] = 0
    return pairs if meet(frame.team, frame.workers) else -1


@part
def room(frame):
    """Return how many pairs ``isect_ids`` may hold; a little more of it is read ahead."""
    return len(frame.isect_ids) - SLACK


@part
def _gather_tiles(first, end, order, tiles, sorted_tiles):
    # A loop of its own: with nothing else to wait for, many of these far loads are under way at once.
    for i in range(first, end):
        sorted_tiles[np.uint64(i)] = tiles[np.uint64(order[np.uint64(i)])]


@part
def _count(first, end, tile_columns, sorted_tiles, counts):
    counts[:] = 0
    for i in range(first, end):
        left, top, right, bottom = _corners(sorted_tiles[np.uint64(i)])
        wide, high = right - left, bottom - top
        if wide < 2 and high < 2:
            # Most splats: four additions, some of zero, are quicker than loops whose ends nobody can predict.
            corner = np.uint64(top * tile_columns + left)
            counts[corner] += 1
            counts[corner + np.uint64(wide)] += wide
            corner += np.uint64(high * tile_columns)
            counts[corner] += high
            counts[corner + np.uint64(wide)] += wide * high
            continue
        for row in range(top, bottom + 1):
            for tile in range(row * tile_columns + left, row * tile_columns + right + 1):
                counts[np.uint64(tile)] += 1


@part
def _scatter(first, end, tile_columns, order, sorted_tiles, cursors, isect_ids):
    for i in range(first, end):
        record = order[np.uint64(i)]
        left, top, right, bottom = _corners(sorted_tiles[np.uint64(i)])
        for row in range(top, bottom + 1):
            for tile in range(row * tile_columns + left, row * tile_columns + right + 1):
                t = np.uint64(tile)
                isect_ids[np.uint64(cursors[t])] = record
                cursors[t] += 1


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
