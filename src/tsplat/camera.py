"""Where the scene is seen from: `Camera` is what a renderer needs, `Pose` is what a person steers.

OpenCV axes: +x right, +y down, +z forward; pixel centres at .5; the image is never mirrored.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from tsplat.errors import CameraError, shown
from tsplat.given import numbers, real, triple, whole

F64 = npt.NDArray[np.float64]
Vector = tuple[float, float, float]
Point = Sequence[float] | npt.NDArray[np.floating]

MAX_SIDE = 16384
"""Longest side of an image in pixels: tile coordinates and memory stay small."""

PITCH_LIMIT = math.radians(89.0)
"""A pose never looks exactly along its up axis, where yaw would lose its meaning."""


@dataclass(frozen=True, eq=False, slots=True)
class Camera:
    """A pinhole camera.

    Attributes
    ----------
    viewmat : ndarray of float64, [4, 4]
        World to camera; the upper left 3x3 is a rotation.
    K : ndarray of float64, [3, 3]
        Intrinsics in pixels: ``[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]``, positive focal lengths.
    width, height : int
        Size of the image in pixels, 1 to 16384.

    Raises
    ------
    CameraError
        The numbers do not form a camera.
    """

    viewmat: F64
    K: F64
    width: int
    height: int

    def __post_init__(self) -> None:
        for name, shape in (("viewmat", (4, 4)), ("K", (3, 3))):
            object.__setattr__(self, name, _matrix(name, getattr(self, name), shape))
        for name in ("width", "height"):
            object.__setattr__(self, name, _side(name, getattr(self, name)))
        if not (self.K[0, 0] > 0 and self.K[1, 1] > 0):
            raise CameraError(f"focal lengths must be positive, got {self.K[0, 0]} and {self.K[1, 1]}")
        if self.K[0, 1] or self.K[1, 0]:
            raise CameraError(f"K must have no skew, 0 beside fx and fy, got {self.K[0, 1]} and {self.K[1, 0]}")
        if self.K[2].tolist() != [0.0, 0.0, 1.0] or self.viewmat[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
            raise CameraError("the last row of K must be 0 0 1, of viewmat 0 0 0 1; is one of them transposed?")
        rotation = self.viewmat[:3, :3]
        if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-4) or np.linalg.det(rotation) < 0:
            raise CameraError("viewmat must hold a rotation: orthonormal, not mirrored; check its axes and scale")

    @classmethod
    def look_at(
        cls,
        eye: Point,
        target: Point,
        up: Point,
        *,
        width: int,
        height: int,
        fov_y: float,
    ) -> Camera:
        """Place a camera at ``eye``, looking at ``target``, with ``up`` towards the top of the image.

        Parameters
        ----------
        eye, target : sequence or array of 3 floats
            Positions in world units; they must differ.
        up : sequence or array of 3 floats
            Direction in the world; when it lies along the view, another one is chosen.
        width, height : int
            Size of the image in pixels.
        fov_y : float
            Vertical field of view in degrees, between 0 and 180.

        Returns
        -------
        Camera
            With square pixels and the principal point in the middle.

        Raises
        ------
        CameraError
            ``eye`` equals ``target``, or a size or angle is out of range.
        """
        place = triple("eye", eye, error=CameraError)
        forward = _unit(triple("target", target, error=CameraError) - place, "target - eye")
        right = np.cross(forward, _unit(triple("up", up, error=CameraError), "up"))
        if np.linalg.norm(right) < 1e-6:
            right = np.cross(forward, _any_perpendicular(forward))
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        viewmat = np.eye(4)
        viewmat[:3, :3], viewmat[:3, 3] = rotation, -rotation @ place
        return cls(viewmat, intrinsics(width, height, fov_y), width, height)

    @property
    def eye(self) -> F64:
        """Position of the camera in the world, float64 [3]."""
        # Without NumPy's matrices, which take longer than all else that a frame asks of its camera.
        (a, b, c, x), (d, e, f, y), (g, h, i, z), _ = self.viewmat.tolist()
        return np.array([-(a * x + d * y + g * z), -(b * x + e * y + h * z), -(c * x + f * y + i * z)])

    @property
    def fov_y(self) -> float:
        """Vertical field of view in degrees."""
        return math.degrees(2.0 * math.atan(0.5 * self.height / float(self.K[1, 1])))

    def shifted(self, origin: Point) -> Camera:
        """Return the same view in coordinates that are counted from ``origin``; see `Gaussians.origin`."""
        viewmat = self.viewmat.copy()
        viewmat[:3, 3] += viewmat[:3, :3] @ np.asarray(origin, np.float64)
        return Camera(viewmat, self.K, self.width, self.height)

    def resized(self, width: int, height: int) -> Camera:
        """Return the same view sampled at another size; the field of view stretches with the sides."""
        width, height = _side("width", width), _side("height", height)
        scale = np.diag([width / self.width, height / self.height, 1.0])
        return Camera(self.viewmat, scale @ self.K, width, height)


@dataclass(frozen=True, slots=True)
class Pose:
    """A camera as a person steers it: a place, two angles and the distance of what is looked at.

    Orbiting turns about the target, flying turns about the eye; the pose is the same, so
    changing from one to the other never jumps.

    Attributes
    ----------
    eye : tuple of 3 floats
        Position in world units.
    yaw, pitch : float
        Radians; yaw grows to the right about ``up``, pitch grows upwards and stays within 89 degrees.
    distance : float
        From the eye to the target in world units, positive.
    up : tuple of 3 floats
        Unit direction in the world that stays upright on screen.
    """

    eye: Vector
    yaw: float
    pitch: float
    distance: float
    up: Vector = (0.0, -1.0, 0.0)

    @classmethod
    def look_at(cls, eye: Point, target: Point, up: Point) -> Pose:
        """Return the pose at ``eye`` whose target is ``target``."""
        ray = triple("target", target, error=CameraError) - triple("eye", eye, error=CameraError)
        forward = _unit(ray, "target - eye")
        axis = _unit(triple("up", up, error=CameraError), "up")
        ahead, aside = _level_axes(axis)
        yaw = math.atan2(float(forward @ aside), float(forward @ ahead))
        pitch = math.asin(max(-1.0, min(1.0, float(forward @ axis))))
        distance = float(np.linalg.norm(ray))
        return cls(_vector(eye), yaw, _clamped(pitch), distance, _vector(axis))

    @property
    def forward(self) -> F64:
        """Unit direction of view, float64 [3]."""
        up = np.asarray(self.up)
        ahead, aside = _level_axes(up)
        level = math.cos(self.yaw) * ahead + math.sin(self.yaw) * aside
        return math.cos(self.pitch) * level + math.sin(self.pitch) * up

    @property
    def right(self) -> F64:
        """Unit direction towards the right of the image, float64 [3]; always level."""
        ahead, aside = _level_axes(np.asarray(self.up))
        return math.cos(self.yaw) * aside - math.sin(self.yaw) * ahead

    @property
    def target(self) -> F64:
        """The point that orbiting turns about, float64 [3]."""
        return np.asarray(self.eye) + self.distance * self.forward

    def orbit(self, yaw: float, pitch: float) -> Pose:
        """Turn the eye about the target by these angles in radians; the target stays where it is."""
        turned = self.turn(yaw, pitch)
        return replace(turned, eye=_vector(self.target - self.distance * turned.forward))

    def turn(self, yaw: float, pitch: float) -> Pose:
        """Turn the view about the eye by these angles in radians."""
        wrapped = math.remainder(self.yaw + yaw, 2.0 * math.pi)
        return replace(self, yaw=wrapped, pitch=_clamped(self.pitch + pitch))

    def move(self, right: float, up: float, forward: float) -> Pose:
        """Move eye and target along the axes of the image by these lengths in world units."""
        image_up = np.cross(self.right, self.forward)
        step = right * self.right + up * image_up + forward * self.forward
        return replace(self, eye=_vector(np.asarray(self.eye) + step))

    def zoom(self, factor: float) -> Pose:
        """Multiply the distance to the target by ``factor``, above 0; the target stays where it is."""
        distance = self.distance * factor
        return replace(self, eye=_vector(self.target - distance * self.forward), distance=distance)

    def with_up(self, up: Point) -> Pose:
        """Return this pose, eye and target kept, with another direction upright."""
        return Pose.look_at(self.eye, _vector(self.target), up)

    def camera(self, width: int, height: int, fov_y: float) -> Camera:
        """Return the camera of this pose; ``fov_y`` in degrees, as in `Camera.look_at`."""
        return Camera.look_at(self.eye, _vector(self.target), self.up, width=width, height=height, fov_y=fov_y)


def intrinsics(width: int, height: int, fov_y: float) -> F64:
    """Return K, float64 [3, 3], for square pixels, a centred principal point and ``fov_y`` in degrees."""
    width, height = _side("width", width), _side("height", height)
    fov_y = real("fov_y", fov_y, "degrees", error=CameraError)
    half = math.tan(0.5 * math.radians(fov_y)) if 0.0 < fov_y < 180.0 else 0.0
    focal = 0.5 * height / half if half else math.inf
    if not math.isfinite(focal):  # which also the smallest angles lead to
        raise CameraError(f"fov_y must be between 0 and 180 degrees, got {fov_y}")
    return np.array([[focal, 0.0, 0.5 * width], [0.0, focal, 0.5 * height], [0.0, 0.0, 1.0]])


def _level_axes(up: F64) -> tuple[F64, F64]:
    """Return the directions of yaw 0 and of yaw 90 degrees, both perpendicular to ``up``."""
    ahead = _any_perpendicular(up)
    return ahead, np.cross(ahead, up)


def _any_perpendicular(axis: F64) -> F64:
    # The world axis farthest from `axis`, z first, made perpendicular: for up = -y, yaw 0 looks along +z.
    other = np.eye(3)[2 - int(np.argmin(np.abs(axis)[::-1]))]
    perpendicular: F64 = other - (other @ axis) * axis
    return perpendicular / np.linalg.norm(perpendicular)


def _clamped(pitch: float) -> float:
    return max(-PITCH_LIMIT, min(PITCH_LIMIT, pitch))


def _side(name: str, pixels: object) -> int:
    return whole(name, pixels, 1, MAX_SIDE, CameraError)


def _matrix(name: str, values: object, shape: tuple[int, int]) -> F64:
    """Return a read-only copy of a finite matrix of this shape."""
    array = numbers(values, "iuf")
    if array is None or array.shape != shape or not np.isfinite(array).all():
        raise CameraError(f"{name} must be finite with shape {list(shape)}, got {shown(values)}")
    matrix = array.astype(np.float64)
    matrix.flags.writeable = False
    return matrix


def _unit(vector: F64, name: str) -> F64:
    length = float(np.linalg.norm(vector))
    if not (length > 0.0 and math.isfinite(length)):
        raise CameraError(f"{name} must be three finite numbers, not all zero, got {vector.tolist()}")
    return vector / length


def _vector(values: Point) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z
