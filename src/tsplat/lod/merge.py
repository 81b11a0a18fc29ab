"""Fewer splats that look alike: of all near pairs, that whose merging changes least is merged, again and again.

Two splats become the one with their mass, mean and covariance, where the mass is opacity times area. What that
changes is the integral of the squared difference, in closed form, of the two blurred Gaussians and the one they
become, plus what their colours lose.

Sources: Salmond 2009, *Mixture reduction algorithms for point and extended object tracking*, for the moments;
Williams and Maybeck 2003, *Cost-function-based Gaussian mixture reduction*, for the difference.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tsplat._jit import kernel, part
from tsplat._lanes import LANES, exp2, fma, load, maximum, minimum, splat, sqrt, store, where_above
from tsplat.raster.prepare import BLOCK, SH_C0

F32 = npt.NDArray[np.float32]

ROOM = 2 * BLOCK
"""Splats that are merged among each other."""

BLUR = np.float32(1.0)
"""Added to the sum of two covariances, in squares of the typical size: what no pixel shows costs nothing."""

FOLD = np.float32(-0.5 * math.log2(math.e))
"""What a squared distance is multiplied by to be an exponent of base 2."""

NOTHING = np.float32(-100.0)
"""The lowest exponent: two to it is nothing, and `exp2` is right for it."""

LANE_COSTS = 14
"""Row of ``lanes`` for the costs, behind what is gathered."""

COLOUR_COST = np.float32(0.5)
"""What a squared difference of colours of 1 costs, per squared mass and density."""

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
    partners: npt.NDArray[np.int32]
    births: npt.NDArray[np.int32]
    partners_births: npt.NDArray[np.int32]
    numbers: F32
    nearest: F32
    nearest_distances: F32
    lanes: F32
    frame: F32


@kernel
def new_scratch(values):
    """Return memory for splats with so many harmonics, all channels counted."""
    return Scratch(
        np.empty(ROOM, np.float32), np.empty(ROOM, np.float32), np.empty(ROOM, np.float32),
        np.empty((ROOM, 6), np.float32), np.empty(ROOM, np.float32), np.empty((ROOM, 3), np.float32),
        np.empty((ROOM, values), np.float32), np.empty(ROOM, np.float32), np.empty(ROOM, np.float32),
        np.empty(ROOM, np.int32), np.empty(ROOM, np.int32), np.empty(ROOM, np.int32),
        np.arange(ROOM).astype(np.float32), np.empty(LANES, np.float32), np.empty(LANES, np.float32),
        np.empty(15 * LANES, np.float32), np.empty(5, np.float32),
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
def merge(scratch, wanted):
    """Merge until only so many are left; return what that changes: square world units times squared opacity."""
    n = np.int64(scratch.frame[4])
    for i in range(n):
        scratch.alone[i] = _alone(scratch.covars, i)
    for i in range(n):
        _find_partner(i, scratch)
    left, changed = n, np.float32(0.0)
    while left > wanted:
        i = _cheapest(scratch.costs, n)
        if scratch.costs[i] == NEVER:
            i, j = _first_two(scratch.x)  # all are so far apart, or so odd, that it does not matter
            _merge_into(i, j, scratch)
            left -= 1
            continue
        j = np.int64(scratch.partners[i])
        if scratch.births[j] != scratch.partners_births[i]:
            _find_partner(i, scratch)  # the partner is not what it was
            continue
        changed += scratch.costs[i]
        _merge_into(i, j, scratch)
        _find_partner(i, scratch)
        left -= 1
    return changed * scratch.frame[3] ** 2


@part
def _cheapest(costs, n):
    i, cost = 0, NEVER
    for each in range(n):
        if costs[each] < cost:
            i, cost = each, costs[each]
    return i


@part
def _first_two(x):
    """Return the first two splats that are left."""
    i = 0
    while x[i] == FAR:
        i += 1
    j = i + 1
    while x[j] == FAR:
        j += 1
    return i, j


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


@part
def _merge_into(i, j, scratch):
    """Make splat i what both are together, and move j out of the way."""
    mass = scratch.masses[i] + scratch.masses[j]
    a, b = scratch.masses[i] / mass, scratch.masses[j] / mass
    dx, dy, dz = scratch.x[i] - scratch.x[j], scratch.y[i] - scratch.y[j], scratch.z[i] - scratch.z[j]
    covars = scratch.covars
    ours = covars[i, 0], covars[i, 1], covars[i, 2], covars[i, 3], covars[i, 4], covars[i, 5]
    theirs = covars[j, 0], covars[j, 1], covars[j, 2], covars[j, 3], covars[j, 4], covars[j, 5]
    xx, xy, xz, yy, yz, zz = _mixture(ours, theirs, a, b, dx, dy, dz)
    covars[i, 0], covars[i, 1], covars[i, 2], covars[i, 3], covars[i, 4], covars[i, 5] = xx, xy, xz, yy, yz, zz
    scratch.x[i], scratch.y[i] = scratch.x[i] - b * dx, scratch.y[i] - b * dy
    scratch.z[i] = scratch.z[i] - b * dz
    for k in range(scratch.sh.shape[1]):
        scratch.sh[i, k] = a * scratch.sh[i, k] + b * scratch.sh[j, k]
    for channel in range(3):
        scratch.colors[i, channel] = a * scratch.colors[i, channel] + b * scratch.colors[j, channel]
    scratch.masses[i] = mass
    scratch.alone[i] = _alone(scratch.covars, i)
    scratch.births[i] += 1
    scratch.births[j] += 1
    scratch.costs[j] = NEVER
    scratch.x[j] = scratch.y[j] = scratch.z[j] = FAR


@part
def _find_partner(i, scratch):
    """Look among the nearest for the one that costs least to merge with."""
    _find_nearest(i, scratch)
    _gather(scratch)
    store(scratch.lanes, LANE_COSTS * LANES, _costs(i, scratch))
    scratch.costs[i] = NEVER
    for lane in range(LANES):
        cost = scratch.lanes[LANE_COSTS * LANES + lane]
        if cost < scratch.costs[i] and scratch.nearest_distances[lane] < FAR:
            j = np.int32(scratch.nearest[lane])
            scratch.costs[i], scratch.partners[i], scratch.partners_births[i] = cost, j, scratch.births[j]


@part
def _find_nearest(i, scratch):
    """Fill ``nearest`` and ``nearest_distances``: of those whose number leaves 0, 1 to 7 over by eight.

    The nearest of all is among them, and most of the next: which numbers splats of a node have is chance.
    """
    x, y, z = splat(scratch.x[i]), splat(scratch.y[i]), splat(scratch.z[i])
    own_x = scratch.x[i]
    scratch.x[i] = FAR
    nearest, distances = load(scratch.numbers, 0), splat(FAR)
    for first in range(0, ROOM, LANES):
        dx, dy = load(scratch.x, first) - x, load(scratch.y, first) - y
        dz = load(scratch.z, first) - z
        squared = fma(dz, dz, fma(dy, dy, dx * dx))
        nearest = where_above(distances, squared, load(scratch.numbers, first), nearest)
        distances = minimum(distances, squared)
    scratch.x[i] = own_x
    store(scratch.nearest, 0, nearest)
    store(scratch.nearest_distances, 0, distances)


@part
def _gather(scratch):
    """Put what is known of the nearest side by side."""
    for lane in range(LANES):
        j = np.int64(scratch.nearest[lane])
        scratch.lanes[lane] = scratch.x[j]
        scratch.lanes[LANES + lane] = scratch.y[j]
        scratch.lanes[2 * LANES + lane] = scratch.z[j]
        for entry in range(6):
            scratch.lanes[(3 + entry) * LANES + lane] = scratch.covars[j, entry]
        scratch.lanes[9 * LANES + lane] = scratch.masses[j]
        scratch.lanes[10 * LANES + lane] = scratch.alone[j]
        for channel in range(3):
            scratch.lanes[(11 + channel) * LANES + lane] = scratch.colors[j, channel]


@part
def _costs(i, scratch):
    """Return what merging with each of the nearest changes: the squared difference, over all space."""
    lanes, covars = scratch.lanes, scratch.covars
    one, two, zero = splat(np.float32(1.0)), splat(np.float32(2.0)), splat(np.float32(0.0))
    first, second = splat(scratch.masses[i]), load(lanes, 9 * LANES)
    mass = first + second
    b = second / mass
    a = one - b
    dx, dy = splat(scratch.x[i]) - load(lanes, 0), splat(scratch.y[i]) - load(lanes, LANES)
    dz = splat(scratch.z[i]) - load(lanes, 2 * LANES)
    ours = (
        splat(covars[i, 0]), splat(covars[i, 1]), splat(covars[i, 2]),
        splat(covars[i, 3]), splat(covars[i, 4]), splat(covars[i, 5]),
    )  # fmt: skip
    theirs = (
        load(lanes, 3 * LANES), load(lanes, 4 * LANES), load(lanes, 5 * LANES),
        load(lanes, 6 * LANES), load(lanes, 7 * LANES), load(lanes, 8 * LANES),
    )  # fmt: skip
    merged = _mixture(ours, theirs, a, b, dx, dy, dz)
    itself, _ = _overlap(merged, merged, dx, dy, dz)
    both, exponent = _overlap(ours, theirs, dx, dy, dz)
    both = both * exp2(exponent)
    with_first, exponent = _overlap(ours, merged, dx, dy, dz)
    with_first = with_first * exp2(b * b * exponent)
    with_second, exponent = _overlap(theirs, merged, dx, dy, dz)
    with_second = with_second * exp2(a * a * exponent)
    alone = first * first * splat(scratch.alone[i]) + second * second * load(lanes, 10 * LANES)
    squares = alone + mass * mass * itself
    products = first * second * both - mass * (first * with_first + second * with_second)
    apart = zero
    for channel in range(3):
        difference = splat(scratch.colors[i, channel]) - load(lanes, (11 + channel) * LANES)
        apart = apart + difference * difference
    colour = splat(COLOUR_COST) * apart * first * second * itself
    return maximum(squares + two * products, zero) + colour


@part
def _overlap(one, other, dx, dy, dz):
    """Return the overlap of two Gaussians, blurred: its size where they lie together, but for (2 pi)^(-3/2).

    And the base-2 exponent of what is left of it where they lie a distance d apart.
    """
    blur = splat(BLUR)
    xx, xy, xz = one[0] + other[0] + blur, one[1] + other[1], one[2] + other[2]
    yy, yz, zz = one[3] + other[3] + blur, one[4] + other[4], one[5] + other[5] + blur
    # The adjugate: the inverse times the determinant.
    axx, axy, axz = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    ayy, ayz, azz = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    inverse = splat(np.float32(1.0)) / (xx * axx + xy * axy + xz * axz)
    straight = dx * dx * axx + dy * dy * ayy + dz * dz * azz
    across = dx * dy * axy + dx * dz * axz + dy * dz * ayz
    exponent = splat(FOLD) * (straight + across + across) * inverse
    return sqrt(inverse), maximum(exponent, splat(NOTHING))


@part
def _mixture(one, other, a, b, dx, dy, dz):
    """Return the covariance of two splats together, with shares a and b of the mass, and a distance d apart."""
    ab = a * b
    return (
        a * one[0] + b * other[0] + ab * dx * dx,
        a * one[1] + b * other[1] + ab * dx * dy,
        a * one[2] + b * other[2] + ab * dx * dz,
        a * one[3] + b * other[3] + ab * dy * dy,
        a * one[4] + b * other[4] + ab * dy * dz,
        a * one[5] + b * other[5] + ab * dz * dz,
    )


@part
def _alone(covars, i):
    """Return the overlap of a splat with itself."""
    two, blur = np.float32(2.0), BLUR
    xx, xy, xz = two * covars[i, 0] + blur, two * covars[i, 1], two * covars[i, 2]
    yy, yz, zz = two * covars[i, 3] + blur, two * covars[i, 4], two * covars[i, 5] + blur
    determinant = xx * (yy * zz - yz * yz) + xy * (xz * yz - xy * zz) + xz * (xy * yz - xz * yy)
    return np.float32(1.0) / math.sqrt(determinant)
