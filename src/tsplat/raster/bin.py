"""Stage 3: which splats touch which tile: count, scan, scatter.

Each pair of a tile and a splat becomes one 64-bit key, its depth above the record's number. Within
a tile the keys are left unsorted: `sort` does that while they are in the cache, and only as far as needed.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tsplat._jit import kernel
from tsplat.raster import record as col
from tsplat.raster.prepare import BLOCK, Prepared
from tsplat.raster.workers import on_threads
from tsplat.rendering import DEPTH_BITS_IGNORED


def bin_tiles(scene: Prepared, tile_columns: int, tile_count: int, threads: int) -> npt.NDArray[np.int64]:
    """Fill ``isect_keys`` of a prepared scene, tile by tile.

    Returns
    -------
    ndarray of int64, [tile_count + 1]
        ``isect_offsets``: where each tile's keys start, and the number of all.
    """
    first_blocks = _shares(scene.visible, threads)
    counts = np.zeros((threads, tile_count), np.int64)
    on_threads(threads, _count, first_blocks, tile_columns, scene.tiles, scene.visible, counts)
    # Worker w writes a tile's keys after those of the workers before it.
    ends = np.cumsum(counts.T.ravel())
    cursors = np.ascontiguousarray((ends - counts.T.ravel()).reshape(tile_count, threads).T)
    isect_offsets = np.append(cursors[0], ends[-1:])
    isect_keys = scene.room_for(int(isect_offsets[-1]))
    record_bits = scene.records.view(np.uint32)
    on_threads(
        threads, _scatter, first_blocks, tile_columns, scene.tiles, scene.visible, record_bits, cursors, isect_keys
    )
    return isect_offsets


def _shares(visible: npt.NDArray[np.int32], threads: int) -> npt.NDArray[np.int64]:
    """Return the block at which each worker starts, and the end, so that all have as many records."""
    done = np.cumsum(visible, dtype=np.int64)
    total = int(done[-1]) if len(done) else 0
    starts = np.searchsorted(done, [total * worker // threads for worker in range(1, threads)])
    return np.concatenate([[0], starts, [len(visible)]]).astype(np.int64)


@kernel
def _count(worker, first_blocks, tile_columns, tiles, visible, counts):
    for block in range(first_blocks[worker], first_blocks[worker + 1]):
        for record in range(block * BLOCK, block * BLOCK + visible[block]):
            r = np.uint64(record)
            left, right = np.int64(tiles[r, 0]), np.int64(tiles[r, 2])
            for row in range(np.int64(tiles[r, 1]), np.int64(tiles[r, 3]) + 1):
                for tile in range(row * tile_columns + left, row * tile_columns + right + 1):
                    counts[worker, np.uint64(tile)] += 1


@kernel
def _scatter(worker, first_blocks, tile_columns, tiles, visible, record_bits, cursors, isect_keys):
    for block in range(first_blocks[worker], first_blocks[worker + 1]):
        for record in range(block * BLOCK, block * BLOCK + visible[block]):
            r = np.uint64(record)
            depth = np.uint64(record_bits[r, col.DEPTH] >> np.uint32(DEPTH_BITS_IGNORED))
            key = (depth << np.uint64(32)) | r
            left, right = np.int64(tiles[r, 0]), np.int64(tiles[r, 2])
            for row in range(np.int64(tiles[r, 1]), np.int64(tiles[r, 3]) + 1):
                for tile in range(row * tile_columns + left, row * tile_columns + right + 1):
                    t = np.uint64(tile)
                    at = cursors[worker, t]
                    isect_keys[np.uint64(at)] = key
                    cursors[worker, t] = at + 1
