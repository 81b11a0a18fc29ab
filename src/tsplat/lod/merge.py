"""Fewer splats that look alike: of all near pairs, that whose merging changes least is merged, again and again.

Two splats become the one with their mass, mean and covariance, where the mass is opacity times area.

Source: Salmond 2009, *Mixture reduction algorithms for point and extended object tracking*.
"""

from __future__ import annotations

import numpy as np

from tsplat._jit import part
from tsplat._lanes import LANES, fma, load, minimum, splat, store, where_above
from tsplat.lod.merge_costs import alone, costs_of, gather, mixture
from tsplat.lod.merge_scratch import FAR, NEVER, ROOM

LANE_COSTS = 14
"""Row of ``lanes`` for the costs, behind what is gathered."""


@part
def merge(scratch, wanted):
    """Merge until only so many are left; return what that changes: square world units times squared opacity."""
    n = np.int64(scratch.frame[4])
    for i in range(n):
        scratch.alone[i] = alone(scratch.covars, i)
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
def _merge_into(i, j, scratch):
    """Make splat i what both are together, and move j out of the way."""
    mass = scratch.masses[i] + scratch.masses[j]
    a, b = scratch.masses[i] / mass, scratch.masses[j] / mass
    dx, dy, dz = scratch.x[i] - scratch.x[j], scratch.y[i] - scratch.y[j], scratch.z[i] - scratch.z[j]
    covars = scratch.covars
    ours = covars[i, 0], covars[i, 1], covars[i, 2], covars[i, 3], covars[i, 4], covars[i, 5]
    theirs = covars[j, 0], covars[j, 1], covars[j, 2], covars[j, 3], covars[j, 4], covars[j, 5]
    xx, xy, xz, yy, yz, zz = mixture(ours, theirs, a, b, dx, dy, dz)
    covars[i, 0], covars[i, 1], covars[i, 2], covars[i, 3], covars[i, 4], covars[i, 5] = xx, xy, xz, yy, yz, zz
    scratch.x[i], scratch.y[i] = scratch.x[i] - b * dx, scratch.y[i] - b * dy
    scratch.z[i] = scratch.z[i] - b * dz
    for k in range(scratch.sh.shape[1]):
        scratch.sh[i, k] = a * scratch.sh[i, k] + b * scratch.sh[j, k]
    for channel in range(3):
        scratch.colors[i, channel] = a * scratch.colors[i, channel] + b * scratch.colors[j, channel]
    scratch.masses[i] = mass
    scratch.alone[i] = alone(scratch.covars, i)
    scratch.births[i] += 1
    scratch.births[j] += 1
    scratch.costs[j] = NEVER
    scratch.x[j] = scratch.y[j] = scratch.z[j] = FAR


@part
def _find_partner(i, scratch):
    """Look among the nearest for the one that costs least to merge with."""
    _find_nearest(i, scratch)
    gather(scratch)
    store(scratch.lanes, LANE_COSTS * LANES, costs_of(i, scratch))
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
