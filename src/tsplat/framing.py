"""Where a scene is, which way is up in it, and where to stand to see it: the start view.

All three look at a sample of the splats and at weighted quantiles, never at extremes: a trained
scene has floaters far outside and a backdrop of few, huge splats.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tsplat.camera import Pose, Vector, intrinsics
from tsplat.errors import CameraError
from tsplat.importance import area
from tsplat.scene import Gaussians

F64 = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

SAMPLE = 8192
"""Splats looked at: quantiles of this many are steady to a percent and take milliseconds."""

REACH = 2.5
"""The bulk ends this many median distances from its middle: beyond a uniform rod, disc or ball, whose
edges lie at 2, 1.4 and 1.3, and far inside the backdrop of an outdoor capture. At 2.2, a rod of a few
hundred splats loses its ends one after the other."""

RESOLVED = 1e-6
"""Of the distance from the origin: what lies in less room than that is one point to float32."""

TAIL = 0.01
"""Share of the weight left out at either end of an axis."""

FILL = 0.94
FIT_TAIL = 0.002
"""Share of the frame that the bulk spans in the start view, and share of its weight that may lie outside."""

START_YAW, START_PITCH = math.radians(-17.0), math.radians(-18.0)
"""A little from the right and from above: two sides and the top show, and text stays readable."""

CLEARANCE = 1.1
"""The start view is at least this many radii from the middle of the bulk."""

UP_DEFAULT: Vector = (0.0, -1.0, 0.0)
UP_CANDIDATES: tuple[Vector, ...] = ((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

FLATNESS = 0.4
"""A splat is flat when its shortest axis is below this share of the next: it lies in a surface."""

GROUND_COSINE = 0.9
GROUND_SHARE = 0.25
GROUND_PEAK = 0.6
GROUND_HEIGHT = 0.15
"""A ground is believed in when a quarter of all flat surface is level within 26 degrees, and three
fifths of that lies within 0.15 heights of the bottom. Scenes with a ground reach 0.34 and 0.77; the
level surfaces of others come to 0.2 and are spread over many heights."""


@dataclass(frozen=True, eq=False, slots=True)
class Bulk:
    """The part of a scene that holds nearly all of its detail.

    Attributes
    ----------
    center : ndarray of float64, [3]
        Middle of the box in world units.
    radius : float
        Of the ball about ``center`` that holds the bulk, in world units, positive.
    low, high : ndarray of float64, [3]
        Corners of the box in world units.
    """

    center: F64
    radius: float
    low: F64
    high: F64


@dataclass(frozen=True, eq=False, slots=True)
class _Sample:
    means: F64
    sizes: F64
    weights: F64

    def only(self, keep: Mask) -> _Sample:
        return _Sample(self.means[keep], self.sizes[keep], self.weights[keep])


def bulk(gaussians: Gaussians) -> Bulk:
    """Return where the scene is, floaters and backdrop left out.

    Parameters
    ----------
    gaussians : Gaussians
        Any scene; an empty one has its bulk around the origin.

    Returns
    -------
    Bulk
        The same for the same scene.
    """
    return _bounds(_inner(_sample(gaussians)))


def guess_up(gaussians: Gaussians) -> Vector:
    """Return the direction that is up in the scene: -y unless there is ground that says +y or +z.

    Returns
    -------
    tuple of 3 floats
        Unit vector along an axis.

    Notes
    -----
    Ground is level surface gathered at one height, at the bottom of the bulk. Scenes without one
    get the default, which is right for files trained from COLMAP cameras.
    """
    return _guess_up(gaussians, bulk(gaussians)) if len(gaussians) else UP_DEFAULT


def _guess_up(gaussians: Gaussians, box: Bulk) -> Vector:
    normals, weights, means = _flat_surface(gaussians)
    near = (np.linalg.norm(means - box.center, axis=1) <= 1.2 * box.radius) & (weights > 0.0)
    normals, weights, means = normals[near], weights[near], means[near]
    for up in UP_CANDIDATES:
        axis = np.array(up)
        level = np.abs(normals @ axis) > GROUND_COSINE
        if weights[level].sum() <= GROUND_SHARE * weights.sum():
            continue
        bottom, top = sorted((float(box.low @ axis), float(box.high @ axis)))
        height = (means[level] @ axis - bottom) / max(top - bottom, 1e-30)
        ground = weights[level][np.abs(height) < GROUND_HEIGHT].sum()
        if ground > GROUND_PEAK * weights[level].sum():
            return up
    return UP_DEFAULT


def start_pose(gaussians: Gaussians, *, aspect: float, fov_y: float, up: Sequence[float] | None = None) -> Pose:
    """Return a view of the whole bulk, from slightly above and aside.

    Parameters
    ----------
    gaussians : Gaussians
        Any scene.
    aspect : float
        Width over height of the image, positive.
    fov_y : float
        Vertical field of view in degrees, between 0 and 180.
    up : sequence of 3 floats, optional
        Direction that is up; by default what the file says, else `guess_up` decides.

    Returns
    -------
    Pose
        Outside the bulk, which fills most of the frame; the same for the same arguments.

    Raises
    ------
    CameraError
        An argument is out of its range.
    """
    if not 0.0 < aspect < math.inf:
        raise CameraError(f"aspect must be positive and finite, got {aspect}")
    half_y = 0.5 / float(intrinsics(1, 1, fov_y)[1, 1])
    inner = _inner(_sample(gaussians))
    box = _bounds(inner)
    if up is None:
        up = gaussians.up
    if up is None:
        up = _guess_up(gaussians, box) if len(gaussians) else UP_DEFAULT
    # The front of y-up scenes faces +z, that of the others the opposite side.
    yaw = START_YAW + (math.pi if np.asarray(up)[1] > 0.9 * np.linalg.norm(up) else 0.0)
    pose = Pose((0.0, 0.0, 0.0), yaw, START_PITCH, 1.0, _unit(up))
    axes = np.stack([pose.right, np.cross(pose.forward, pose.right), pose.forward])
    shift, distance = _fit((inner.means - box.center) @ axes.T, inner, np.array([half_y * aspect, half_y]))
    target = box.center + shift @ axes[:2]
    distance = max(distance, CLEARANCE * box.radius + float(np.linalg.norm(shift)))
    return Pose.look_at(tuple(target - distance * pose.forward), tuple(target), pose.up)


def _fit(points: F64, inner: _Sample, half: F64) -> tuple[F64, float]:
    # Distance, and sideways shift of the target, at which the points [N, 3] in camera axes
    # fill the frame whose half sides at depth 1 are `half` [2].
    shift, distance = np.zeros(2), 0.0
    for _ in range(4):
        reach = (np.abs(points[:, :2] - shift) + inner.sizes[:, None]) / (FILL * half) - points[:, 2:]
        distance = _quantile(reach.max(axis=1), inner.weights, 1.0 - FIT_TAIL) if len(points) else 0.0
        depths = points[:, 2] + distance
        ahead = inner.weights * (depths > 1e-3 * distance)
        if not ahead.any():
            break
        for axis in range(2):
            slopes = (points[:, axis] - shift[axis]) / np.maximum(depths, 1e-3 * distance)
            middle = 0.5 * (_quantile(slopes, ahead, FIT_TAIL) + _quantile(slopes, ahead, 1.0 - FIT_TAIL))
            shift[axis] += middle * distance
    return shift, distance


def _sample(gaussians: Gaussians) -> _Sample:
    step = 1 + len(gaussians) // SAMPLE
    areas = area(gaussians.scales[::step])
    weights = gaussians.opacities[::step].astype(np.float64)
    if len(areas):
        # Beyond the median a larger splat counts no more: backdrops are few and huge.
        weights *= np.minimum(areas, np.median(areas))
    if not weights.sum() > 0.0:
        weights = np.ones(len(areas))
    return _Sample(gaussians.means[::step].astype(np.float64), np.sqrt(areas), weights)


def _inner(sample: _Sample) -> _Sample:
    # Trim what is far from the middle, find the middle again, until nothing changes.
    inner = sample
    for _ in range(16):
        if not len(inner.means):
            break
        middle = np.array([_quantile(column, inner.weights, 0.5) for column in inner.means.T])
        reach = REACH * _quantile(np.linalg.norm(inner.means - middle, axis=1), inner.weights, 0.5)
        trimmed = sample.only(np.linalg.norm(sample.means - middle, axis=1) <= reach)
        if len(trimmed.means) == len(inner.means):
            break
        inner = trimmed
    return inner


def _bounds(inner: _Sample) -> Bulk:
    if not len(inner.means):
        return Bulk(np.zeros(3), 1.0, -np.ones(3), np.ones(3))
    low = np.array([_quantile(column, inner.weights, TAIL) for column in inner.means.T])
    high = np.array([_quantile(column, inner.weights, 1.0 - TAIL) for column in inner.means.T])
    center = 0.5 * (low + high)
    radius = _quantile(np.linalg.norm(inner.means - center, axis=1), inner.weights, 1.0 - TAIL)
    # One splat, or many in one place, are as large as they are drawn.
    size = 3.0 * _quantile(inner.sizes, inner.weights, 0.5)
    resolved = RESOLVED * float(np.linalg.norm(center))
    return Bulk(center, max(radius, size, resolved) or 1e-4, low, high)


def _flat_surface(gaussians: Gaussians) -> tuple[F64, F64, F64]:
    # Normals [N, 3], weights [N] and centres [N, 3] of sampled splats; weight 0 where not flat.
    step = 1 + len(gaussians) // SAMPLE
    scales = gaussians.scales[::step].astype(np.float64)
    shortest = np.argmin(scales, axis=1)
    ordered = np.sort(scales, axis=1)
    areas = ordered[:, 1] * ordered[:, 2]
    weights: F64 = gaussians.opacities[::step].astype(np.float64) * np.minimum(areas, np.quantile(areas, 0.95))
    weights[ordered[:, 0] >= FLATNESS * ordered[:, 1]] = 0.0
    w, x, y, z = gaussians.quats[::step].astype(np.float64).T
    columns = (
        (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)),
        (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)),
        (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)),
    )
    axes = np.array(columns)  # [axis of the splat, axis of the world, N]
    normals = axes[shortest, :, np.arange(len(shortest))]
    return normals, weights, gaussians.means[::step].astype(np.float64)


def _unit(vector: Sequence[float]) -> Vector:
    length = float(np.linalg.norm(vector))
    if len(vector) != 3 or not 0.0 < length < math.inf:
        raise CameraError(f"up must be three finite numbers, not all zero, got {tuple(vector)}")
    x, y, z = (float(value) / length for value in vector)
    return x, y, z


def _quantile(values: F64, weights: F64, share: float) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order[min(int(np.searchsorted(total, share * total[-1])), len(order) - 1)]])
