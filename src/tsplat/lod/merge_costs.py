"""What merging two splats changes, for one splat and eight of its neighbours at once.

It is the integral of the squared difference, in closed form, of the two blurred Gaussians and the one they become,
plus what their colours lose.

Source: Williams and Maybeck 2003, *Cost-function-based Gaussian mixture reduction*.
"""

from __future__ import annotations

import math

import numpy as np

from tsplat._jit import part
from tsplat._lanes import LANES, exp2, load, maximum, splat, sqrt

BLUR = np.float32(1.0)
"""Added to the sum of two covariances, in squares of the typical size: what no pixel shows costs nothing."""

FOLD = np.float32(-0.5 * math.log2(math.e))
"""What a squared distance is multiplied by to be an exponent of base 2."""

NOTHING = np.float32(-100.0)
"""The lowest exponent: two to it is nothing, and `exp2` is right for it."""

COLOUR_COST = np.float32(0.5)
"""What a squared difference of colours of 1 costs, per squared mass and density."""


@part
def gather(scratch):
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
def costs_of(i, scratch):
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
    merged = mixture(ours, theirs, a, b, dx, dy, dz)
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
def mixture(one, other, a, b, dx, dy, dz):
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
def alone(covars, i):
    """Return the overlap of a splat with itself."""
    two, blur = np.float32(2.0), BLUR
    xx, xy, xz = two * covars[i, 0] + blur, two * covars[i, 1], two * covars[i, 2]
    yy, yz, zz = two * covars[i, 3] + blur, two * covars[i, 4], two * covars[i, 5] + blur
    determinant = xx * (yy * zz - yz * yz) + xy * (xz * yz - xy * zz) + xz * (xy * yz - xz * yy)
    return np.float32(1.0) / math.sqrt(determinant)
