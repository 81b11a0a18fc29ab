"""Images in parts, where the work on all of one at once would take more memory than it may.

A part is a window of tiles. What is drawn in a tile depends on the splats that touch it alone, so the bits are the
same however an image is divided; splats that touch several parts are projected once for each.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from tsplat._jit import kernel
from tsplat.memory import free_memory
from tsplat.raster.buffers import Buffers
from tsplat.raster.frame import PAIR_BYTES, SPLAT_BYTES, Window
from tsplat.raster.prepare import BLOCK
from tsplat.raster.sight import in_sight
from tsplat.rendering import RenderOptions

I32 = npt.NDArray[np.int32]

SMALL = 64 << 20
"""Bytes of work that no frame is denied, so that nobody has to ask what is free."""

FREE_SHARE = 0.5
"""Of the memory that is free, what a frame may take where nobody says how much."""

MOST_PAIRS = 1 << 28
"""Pairs of a tile and a splat listed at a time: their places are counted in 32 bits, and more of them at once is
not faster."""


def work_bytes(blocks: int, pairs: int) -> int:
    """Return how many bytes the work on a frame of so many blocks and pairs takes, beside the image."""
    return SPLAT_BYTES * BLOCK * blocks + PAIR_BYTES * pairs


def most_pairs(wanted: int, blocks: int, options: RenderOptions, buffers: Buffers) -> int:
    """Return how many of so many pairs a frame of so many blocks may list: at least what one tile may have."""
    wanted = min(wanted, MOST_PAIRS)
    limit = _limit(work_bytes(blocks, wanted), options, buffers)
    return max(BLOCK * blocks, min(wanted, (limit - work_bytes(blocks, 0)) // PAIR_BYTES))


def parts_for(blocks: int, options: RenderOptions, buffers: Buffers) -> int:
    """Return into how many parts an image has to be divided so that the splats of each have room."""
    wanted = work_bytes(blocks, BLOCK * blocks)
    return max(1, math.ceil(wanted / _limit(wanted, options, buffers)))


def _limit(wanted: int, options: RenderOptions, buffers: Buffers) -> int:
    """Return how many bytes a frame that wants so many may take."""
    if options.memory:
        return options.memory
    if wanted <= SMALL:
        return SMALL
    return max(SMALL, int(FREE_SHARE * (free_memory() + buffers.nbytes)))


def divided(window: Window, parts: int, columns: int) -> list[Window]:
    """Return a window as about so many, at least two: whole rows of tiles, or parts of one row; one tile as it is.

    The last comes first, as one takes them from the end.
    """
    first, end = window
    unit = columns if end - first > columns else 1
    units = (end - first) // unit
    parts = min(max(parts, 2), units)
    edges = [first + unit * (units * part // parts) for part in range(parts + 1)]
    return [Window(*edges[part : part + 2]) for part in reversed(range(parts))]


def blocks_in_sight(blocks: I32, numbers: npt.NDArray[np.float32], bounds: npt.NDArray[np.float32]) -> I32:
    """Return those blocks, in their order, that may reach into a window."""
    kept = np.empty_like(blocks)
    return kept[: _keep_in_sight(blocks, numbers, bounds, kept)]


@kernel
def _keep_in_sight(blocks, numbers, bounds, kept):
    found = 0
    for place in range(len(blocks)):
        kept[found] = blocks[place]
        found += 1 if in_sight(np.int64(blocks[place]), numbers, bounds) else 0
    return found
