"""A worker's memory for the splats of two blocks that are merged: filled from a level, written back to the next.

Lengths are in units of the typical size of these splats, from their middle, so that float32 holds all of them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tsplat._jit import part
from tsplat._lanes import LANES
from tsplat.raster.prepare import BLOCK
from tsplat.scene import SH_C0

F32 = npt.NDArray[np.float32]
I32 = npt.NDArray[np.int32]

ROOM = 2 * BLOCK
"""Splats that are merged among each other."""

FAR = np.float32(1e18)
"""Where splats are moved that are merged into others, in units of the typical size of a splat."""

NEVER = np.float32(np.inf)

LEAST_SIZE = np.float32(1e-15)
"""World units. No splat and no distance counts as smaller."""

LEAST_SHARE = np.float32(1e-5)
"""Of the largest distance or splat, that the typical size is at least."""

LEAST_MASS = np.float32(1e-20)
"""Of a splat that is not seen at all, so that its share of two such is a number."""


class Scratch(NamedTuple):
    """A worker's memory for one node; lengths in units of the typical size of its splats, from their middle.

    Attributes
    ----------
    x, y, z : ndarray of float32, [ROOM]
        Centres.
    covars : ndarray of float32, [ROOM, 6]
        Upper triangles of the covariances.
    masses : ndarray of float32, [ROOM]
        Opacity times area.
    colors : ndarray of float32, [ROOM, 3]
        Red, green and blue without what depends on the direction.
    sh : ndarray of float32, [ROOM, K * 3]
        All harmonics.
    alone : ndarray of float32, [ROOM]
        The integral of the square of each, per squared mass.
    costs : ndarray of float32, [ROOM]
        Of merging each with its partner.
    partners : ndarray of int32, [ROOM]
        The neighbour that costs least.
    births, partners_births : ndarray of int32, [ROOM]
        How often each was merged, and its partner when the cost was worked out.
    numbers : ndarray of float32, [ROOM]
        0, 1, 2 and so on.
    nearest, nearest_distances : ndarray of float32, [LANES]
        Numbers of splats near to one, and their squared distances.
    lanes : ndarray of float32, [15 * LANES]
        What is known of these, side by side.
    frame : ndarray of float32, [5]
        The middle, the typical size of a splat, and how many splats there are.
    """

    x: F32
    y: F32
    z: F32
    covars: F32
    masses: F32
    colors: F32
    sh: F32
    alone: F32
    costs: F32
    partners: I32
    births: I32
    partners_births: I32
    numbers: F32
    nearest: F32
    nearest_distances: F32
    lanes: F32
    frame: F32


def new_scratch(threads: int, values: int) -> Scratch:
    """Return memory of some workers, side by side, for splats with so many harmonics, all channels counted."""

    def floats(*shape: int) -> F32:
        return np.empty((threads, *shape), np.float32)

    def integers() -> I32:
        return np.empty((threads, ROOM), np.int32)

    return Scratch(
        floats(ROOM), floats(ROOM), floats(ROOM), floats(ROOM, 6), floats(ROOM), floats(ROOM, 3),
        floats(ROOM, values), floats(ROOM), floats(ROOM), integers(), integers(), integers(),
        np.tile(np.arange(ROOM, dtype=np.float32), (threads, 1)), floats(LANES), floats(LANES),
        floats(15 * LANES), floats(5),
    )  # fmt: skip


@part
def of_worker(scratch, worker):
    """Return what belongs to one worker."""
    return Scratch(
        scratch.x[worker], scratch.y[worker], scratch.z[worker], scratch.covars[worker], scratch.masses[worker],
        scratch.colors[worker], scratch.sh[worker], scratch.alone[worker], scratch.costs[worker],
        scratch.partners[worker], scratch.births[worker], scratch.partners_births[worker], scratch.numbers[worker],
        scratch.nearest[worker], scratch.nearest_distances[worker], scratch.lanes[worker], scratch.frame[worker],
    )  # fmt: skip


@part
def take(level, start, end, scratch):
    """Fill the scratch memory with the splats from ``start`` to ``end`` of a level."""
    n = end - start
    _fill_frame(level, start, end, scratch)
    unit = np.float32(1.0) / scratch.frame[3]
    for i in range(n):
        row = start + i
        scratch.x[i] = (level.means[row, 0] - scratch.frame[0]) * unit
        scratch.y[i] = (level.means[row, 1] - scratch.frame[1]) * unit
        scratch.z[i] = (level.means[row, 2] - scratch.frame[2]) * unit
        for entry in range(6):
            scratch.covars[i, entry] = level.covars[row, entry] * unit * unit
        scratch.masses[i] = max(level.opacities[row] * area(scratch.covars, i), LEAST_MASS)
        for k in range(level.sh.shape[1]):
            for channel in range(3):
                scratch.sh[i, 3 * k + channel] = level.sh[row, k, channel]
        for channel in range(3):
            scratch.colors[i, channel] = np.float32(SH_C0) * scratch.sh[i, channel]
        scratch.births[i] = 0
    for i in range(n, ROOM):
        scratch.x[i] = scratch.y[i] = scratch.z[i] = FAR
        scratch.costs[i] = NEVER


@part
def _fill_frame(level, start, end, scratch):
    """Fill the middle, the typical size, and the number of splats.

    The size is not so small that a number of the others, in units of it, would leave float32.
    """
    frame = scratch.frame
    reach2, reach = np.float32(0.0), np.float32(0.0)
    for axis in range(3):
        total = 0.0
        for i in range(start, end):
            total += level.means[i, axis]
        frame[axis] = total / (end - start)
    for i in range(start, end):
        reach2 = max(reach2, level.covars[i, 0], level.covars[i, 3], level.covars[i, 5])
        for axis in range(3):
            reach = max(reach, abs(level.means[i, axis] - frame[axis]))
    reach = max(reach, np.float32(math.sqrt(reach2)), LEAST_SIZE)
    whole, weighted = np.float32(0.0), np.float32(0.0)
    for i in range(start, end):
        for entry in range(6):
            scratch.covars[0, entry] = level.covars[i, entry] / reach / reach
        size = area(scratch.covars, 0)
        whole += level.opacities[i] * size
        weighted += level.opacities[i] * size * size
    typical = math.sqrt(weighted / whole) if whole > np.float32(0.0) else np.float32(0.0)
    frame[3], frame[4] = reach * max(typical, LEAST_SHARE), end - start


@part
def keep(scratch, level, start):
    """Write those that are left to a level."""
    n, unit = np.int64(scratch.frame[4]), scratch.frame[3]
    row = start
    for i in range(n):
        if scratch.x[i] == FAR:
            continue
        level.opacities[row] = min(np.float32(1.0), scratch.masses[i] / area(scratch.covars, i))
        level.means[row, 0] = scratch.x[i] * unit + scratch.frame[0]
        level.means[row, 1] = scratch.y[i] * unit + scratch.frame[1]
        level.means[row, 2] = scratch.z[i] * unit + scratch.frame[2]
        for entry in range(6):
            level.covars[row, entry] = scratch.covars[i, entry] * unit * unit
        for k in range(level.sh.shape[1]):
            for channel in range(3):
                level.sh[row, k, channel] = scratch.sh[i, 3 * k + channel]
        row += 1


@part
def area(covars, i):
    """Return the root of the mean squared shadow along the three axes, in units of pi, whatever way they point."""
    xx, xy, xz, yy, yz, zz = covars[i, 0], covars[i, 1], covars[i, 2], covars[i, 3], covars[i, 4], covars[i, 5]
    squares = (xx * yy - xy * xy) + (xx * zz - xz * xz) + (yy * zz - yz * yz)
    return math.sqrt(max(squares, np.float32(1e-30)) / np.float32(3.0))
