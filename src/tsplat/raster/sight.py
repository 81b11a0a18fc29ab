"""Whether any splat of a block can be seen: those that lie together in the file are passed over together."""

from __future__ import annotations

import math

import numpy as np

from tsplat._jit import part
from tsplat.raster.prepare import BOUNDS

SPARE = 1e-4
"""Share of the distances that is added to them, more than rounding can take away."""


@part
def in_sight(block, numbers, bounds):
    """Return whether any splat of a block may reach into the image.

    None does where the nearest of them is farther beyond the plane through the eye and an edge than it reaches.
    """
    right, left, below, above, reach_x, reach_y = numbers[31:37]
    near, far = numbers[22], numbers[23]
    x, y, z, radius, scale = seen_from_the_eye(block, numbers, bounds)
    reach_x, reach_y = reach_x * scale, reach_y * scale
    return (
        z + radius > near
        and z - radius < far
        and _beyond(x, z, right) <= reach_x + radius * _length(right)
        and _beyond(-x, z, left) <= reach_x + radius * _length(left)
        and _beyond(y, z, below) <= reach_y + radius * _length(below)
        and _beyond(-y, z, above) <= reach_y + radius * _length(above)
    )


@part
def share_in_sight(block, numbers, bounds):
    """Return about what share of a block's splats is in the image, as if they filled their bounds evenly."""
    right, left, below, above, _, _ = numbers[31:37]
    x, y, z, radius, _ = seen_from_the_eye(block, numbers, bounds)
    return (
        _share_before(_beyond(x, z, right) / _length(right), radius)
        * _share_before(_beyond(-x, z, left) / _length(left), radius)
        * _share_before(_beyond(y, z, below) / _length(below), radius)
        * _share_before(_beyond(-y, z, above) / _length(above), radius)
        * _share_before(numbers[22] - z, radius)
    )


@part
def _share_before(beyond, radius):
    """Return what share of a ball lies before a plane, when its middle lies so far beyond it."""
    half = np.float32(0.5)
    return min(max(half - half * beyond / radius, np.float32(0.0)), np.float32(1.0))


@part
def seen_from_the_eye(block, numbers, bounds):
    """Return a block's middle in the camera's axes, how far its centres are from it, and its largest scale."""
    r00, r01, r02, tx, r10, r11, r12, ty, r20, r21, r22, tz = numbers[:12]
    at = block * BOUNDS
    mx, my, mz, radius, scale = bounds[at : at + BOUNDS]
    x, y, z = (
        r00 * mx + r01 * my + r02 * mz + tx,
        r10 * mx + r11 * my + r12 * mz + ty,
        r20 * mx + r21 * my + r22 * mz + tz,
    )
    radius += np.float32(SPARE) * (radius + abs(mx) + abs(my) + abs(mz) + abs(tx) + abs(ty) + abs(tz))
    return x, y, z, radius, scale


@part
def _beyond(sideways, forward, tangent):
    return sideways - tangent * forward


@part
def _length(tangent):
    return math.sqrt(np.float32(1.0) + tangent * tangent)
