"""Where to stand to see a scene: outside of its bulk, which fills the frame."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tsplat.camera import Pose, Vector, intrinsics
from tsplat.errors import CameraError
from tsplat.framing.bulk import bounds
from tsplat.framing.sample import Sample, quantile
from tsplat.framing.trim import trimmed_sample
from tsplat.framing.up import guess_up_of
from tsplat.scene import Gaussians

F64 = npt.NDArray[np.float64]

FILL = 0.94
FIT_TAIL = 0.002
"""Share of the frame that the bulk spans in the start view, and share of its weight that may lie outside."""

START_YAW, START_PITCH = math.radians(-17.0), math.radians(-18.0)
"""A little from the right and from above: two sides and the top show, and text stays readable."""

CLEARANCE = 1.1
"""The start view is at least this many radii from the middle of the bulk."""


def start_pose(
    gaussians: Gaussians, *, aspect: float, fov_y: float, up: Sequence[float] | None = None, turn: float = 0.0
) -> Pose:
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
        Direction that is up; by default `guess_up` decides.
    turn : float
        Radians by which to go round to another side.

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
    inner = trimmed_sample(gaussians)
    box = bounds(inner)
    if up is None:
        up = guess_up_of(gaussians, inner, box).direction
    pose = _looking(_unit(up), turn)
    axes = np.stack([pose.right, np.cross(pose.forward, pose.right), pose.forward])
    shift, distance = _fit((inner.means - box.center) @ axes.T, inner, np.array([half_y * aspect, half_y]))
    target = box.center + shift @ axes[:2]
    distance = max(distance, CLEARANCE * box.radius + float(np.linalg.norm(shift)))
    return Pose.look_at(tuple(target - distance * pose.forward), tuple(target), pose.up)


def _looking(up: Vector, turn: float) -> Pose:
    """Return a view from the front, or so much further around, as from where the axis nearest to ``up`` is up."""
    nearest = int(np.argmax(np.abs(up)))
    axis = np.sign(up[nearest]) * np.eye(3)[nearest]
    # The front of y-up scenes faces +z, that of the others the opposite side.
    yaw = START_YAW + (math.pi if axis[1] > 0.0 else 0.0)
    ahead = Pose((0.0, 0.0, 0.0), yaw, START_PITCH, 1.0, tuple(axis)).forward
    front = Pose.look_at((0.0, 0.0, 0.0), ahead, up)
    return front.turn(turn, START_PITCH - front.pitch)


def _fit(points: F64, inner: Sample, half: F64) -> tuple[F64, float]:
    # Distance, and sideways shift of the target, at which the points [N, 3] in camera axes
    # fill the frame whose half sides at depth 1 are `half` [2].
    shift, distance = np.zeros(2), 0.0
    for _ in range(4):
        reach = (np.abs(points[:, :2] - shift) + inner.sizes[:, None]) / (FILL * half) - points[:, 2:]
        distance = quantile(reach.max(axis=1), inner.weights, 1.0 - FIT_TAIL) if len(points) else 0.0
        depths = points[:, 2] + distance
        ahead = inner.weights * (depths > 1e-3 * distance)
        if not ahead.any():
            break
        for axis in range(2):
            slopes = (points[:, axis] - shift[axis]) / np.maximum(depths, 1e-3 * distance)
            middle = 0.5 * (quantile(slopes, ahead, FIT_TAIL) + quantile(slopes, ahead, 1.0 - FIT_TAIL))
            shift[axis] += middle * distance
    return shift, distance


def _unit(vector: Sequence[float]) -> Vector:
    length = float(np.linalg.norm(vector))
    if len(vector) != 3 or not 0.0 < length < math.inf:
        raise CameraError(f"up must be three finite numbers, not all zero, got {tuple(vector)}")
    x, y, z = (float(value) / length for value in vector)
    return x, y, z
