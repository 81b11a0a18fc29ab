"""All stages of a frame as one kernel: the workers go from stage to stage together, without Python in between."""

from __future__ import annotations

from tsplat._jit import kernel, part
from tsplat._threads import nanoseconds
from tsplat.raster.bin import bin_tiles, room
from tsplat.raster.composite import composite
from tsplat.raster.project import project
from tsplat.raster.sort import sort


@kernel
def draw(worker, frame):
    """Draw a frame; return how many pairs of a tile and a splat it needs room for.

    Worker 0 writes into ``stamps`` when each stage was done, in nanoseconds of the monotonic clock. As the
    workers wait for each other at the end of a stage, that is when all were.
    """
    if not project(worker, frame):
        return -1
    _stamp(worker, frame, 0)
    if not sort(worker, frame):
        return -1
    _stamp(worker, frame, 1)
    pairs = bin_tiles(worker, frame)
    _stamp(worker, frame, 2)
    if 0 <= pairs <= room(frame):
        composite(worker, frame)
        _stamp(worker, frame, 3)
    return pairs


@part
def _stamp(worker, frame, stage):
    if worker == 0:
        frame.stamps[stage] = nanoseconds()
