"""Cameras and poses: nothing is mirrored, and steering obeys its laws."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tsplat.camera import PITCH_LIMIT, Camera, Pose, intrinsics
from tsplat.errors import CameraError

COORDINATE = st.floats(-100.0, 100.0, width=32)
PLACES = st.tuples(COORDINATE, COORDINATE, COORDINATE)
ANGLES = st.floats(-3.0, 3.0)
AXES = ((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.6, 0.0, -0.8))
UPS = st.sampled_from(AXES)


@st.composite
def poses(draw: st.DrawFn) -> Pose:
    return Pose(draw(PLACES), draw(ANGLES), draw(st.floats(-1.5, 1.5)), draw(st.floats(0.1, 50.0)), draw(UPS))


def look(**changes: Any) -> Camera:
    usual = {"eye": (0, 0, -4), "target": (0, 0, 0), "up": (0, -1, 0), "width": 200, "height": 100, "fov_y": 90.0}
    return Camera.look_at(**{**usual, **changes})


def pixel(camera: Camera, point: Any) -> tuple[float, float, float]:
    """Return x and y in pixels and the depth of a point of the world."""
    seen = camera.viewmat[:3, :3] @ np.asarray(point, np.float64) + camera.viewmat[:3, 3]
    x, y, depth = camera.K @ seen
    return x / depth, y / depth, depth


def test_the_axes_are_opencvs() -> None:
    camera = look()
    np.testing.assert_allclose(
        camera.viewmat, [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]], atol=1e-12
    )
    np.testing.assert_allclose(camera.K, [[50, 0, 100], [0, 50, 50], [0, 0, 1]])
    assert pixel(camera, (1, 0, 0)) == pytest.approx((112.5, 50.0, 4.0)), "+x is to the right"
    assert pixel(camera, (0, 1, 0)) == pytest.approx((100.0, 62.5, 4.0)), "+y is down"
    assert camera.fov_y == pytest.approx(90.0)


@settings(deadline=None)
@given(PLACES, PLACES, UPS)
def test_looking_at_puts_the_target_in_the_middle_and_up_upwards(eye: Any, target: Any, up: Any) -> None:
    ray = np.subtract(target, eye)
    assume(np.linalg.norm(ray) > 0.1)
    camera = look(eye=eye, target=target, up=up)
    x, y, depth = pixel(camera, target)
    assert (x, y) == pytest.approx((100.0, 50.0), abs=1e-6)
    assert depth == pytest.approx(float(np.linalg.norm(ray)))
    assert np.linalg.det(camera.viewmat[:3, :3]) == pytest.approx(1.0), "not mirrored"
    np.testing.assert_allclose(camera.eye, eye, atol=1e-9 * (1 + np.abs(eye).max()))
    right, down = camera.viewmat[0, :3], camera.viewmat[1, :3]
    assert down @ np.asarray(up) < 1e-6
    if np.linalg.norm(np.cross(ray, up)) > 1e-3:
        assert right @ np.asarray(up) == pytest.approx(0.0, abs=1e-6), "the horizon is level"


@pytest.mark.parametrize("up", [(0, 0, 1), (0, 0, -1), (0, 0, 5)])
def test_looking_along_up_still_makes_a_camera(up: tuple[float, float, float]) -> None:
    assert pixel(look(up=up), (0, 0, 0)) == pytest.approx((100.0, 50.0, 4.0))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"target": (0, 0, -4)}, "target - eye must be three finite numbers, not all zero"),
        ({"target": (0, math.nan, 0)}, "target must be three"),
        ({"up": (0, 0, 0)}, "up must be three finite numbers"),
        ({"up": (0, 1)}, "up must be"),
        ({"fov_y": 0.0}, "fov_y must be between 0 and 180"),
        ({"fov_y": 180.0}, "fov_y must be between"),
        ({"fov_y": math.nan}, "fov_y must be degrees, got nan"),
        ({"width": 0}, "width must be 1 to 16384, got 0"),
        ({"height": 16385}, "height must be 1 to 16384"),
    ],
)
def test_impossible_views_are_refused_by_name(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(CameraError, match=message):
        look(**changes)


@pytest.mark.parametrize(
    ("viewmat", "K", "message"),
    [
        (np.eye(3), np.eye(3), r"viewmat must be finite with shape \[4, 4\]"),
        (np.full((4, 4), np.nan), np.eye(3), "viewmat must be finite"),
        (np.diag([1.0, 1, -1, 1]), np.eye(3), "not mirrored"),
        (np.diag([2.0, 2, 2, 1]), np.eye(3), "must hold a rotation"),
        (np.eye(4), np.eye(4), "K must be finite with shape"),
        (np.eye(4), np.diag([1.0, -1, 1]), "focal lengths must be positive"),
    ],
)
def test_matrices_that_are_no_camera_are_refused(viewmat: Any, K: Any, message: str) -> None:
    with pytest.raises(CameraError, match=message):
        Camera(viewmat, K, 10, 10)


def test_a_camera_keeps_its_own_matrices() -> None:
    viewmat = np.eye(4)
    camera = Camera(viewmat, np.eye(3), 10, 10)
    viewmat[0, 3] = 5.0
    assert camera.viewmat[0, 3] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        camera.K[0, 0] = 2.0


def test_resizing_moves_points_with_the_sides() -> None:
    camera, larger = look(), look().resized(600, 200)
    x, y, depth = pixel(camera, (1, 1, 1))
    assert pixel(larger, (1, 1, 1)) == pytest.approx((3 * x, 2 * y, depth))
    assert larger.fov_y == pytest.approx(camera.fov_y)


def test_intrinsics_have_square_pixels_and_a_centred_principal_point() -> None:
    np.testing.assert_allclose(intrinsics(30, 20, 90.0), [[10, 0, 15], [0, 10, 10], [0, 0, 1]])


@settings(deadline=None)
@given(poses(), st.floats(5.0, 170.0))
def test_a_poses_camera_stands_at_its_eye_and_looks_ahead(pose: Pose, fov_y: float) -> None:
    camera = pose.camera(64, 48, fov_y)
    np.testing.assert_allclose(camera.eye, pose.eye, atol=1e-9)
    np.testing.assert_allclose(camera.viewmat[2, :3], pose.forward, atol=1e-6)
    np.testing.assert_allclose(camera.viewmat[0, :3], pose.right, atol=1e-5)


@settings(deadline=None)
@given(PLACES, PLACES, UPS)
def test_a_pose_looks_where_it_was_told(eye: Any, target: Any, up: Any) -> None:
    ray = np.subtract(target, eye, dtype=np.float64)
    distance = float(np.linalg.norm(ray))
    assume(distance > 0.1)
    pose = Pose.look_at(eye, target, up)
    assert pose.eye == pytest.approx(eye)
    assert pose.distance == pytest.approx(distance)
    if abs(ray @ np.asarray(up)) < distance * math.sin(PITCH_LIMIT):
        np.testing.assert_allclose(pose.target, target, atol=1e-5 * distance + 1e-9)
    assert abs(pose.pitch) <= PITCH_LIMIT


@settings(deadline=None)
@given(poses(), ANGLES, st.floats(-3.0, 3.0))
def test_orbiting_keeps_the_target_and_the_distance(pose: Pose, yaw: float, pitch: float) -> None:
    turned = pose.orbit(yaw, pitch)
    np.testing.assert_allclose(turned.target, pose.target, atol=1e-9)
    assert np.linalg.norm(np.subtract(turned.eye, turned.target)) == pytest.approx(pose.distance)
    assert abs(turned.pitch) <= PITCH_LIMIT
    assert abs(turned.yaw) <= math.pi


@settings(deadline=None)
@given(poses(), ANGLES)
def test_orbiting_back_returns(pose: Pose, yaw: float) -> None:
    there_and_back = pose.orbit(yaw, 0.0).orbit(-yaw, 0.0)
    np.testing.assert_allclose(there_and_back.eye, pose.eye, atol=1e-9)


@settings(deadline=None)
@given(poses())
def test_turning_right_moves_the_view_to_the_right_and_up_upwards(pose: Pose) -> None:
    assert pose.turn(0.1, 0.0).forward @ pose.right > 0.0
    assert pose.turn(0.1, 0.3).eye == pose.eye
    if abs(pose.pitch) < PITCH_LIMIT - 0.1:
        assert pose.turn(0.0, 0.1).forward @ np.asarray(pose.up) > pose.forward @ np.asarray(pose.up)


@settings(deadline=None)
@given(poses(), st.floats(-5, 5), st.floats(-5, 5), st.floats(-5, 5))
def test_moving_shifts_the_picture_the_other_way(pose: Pose, right: float, up: float, forward: float) -> None:
    camera = pose.camera(64, 48, 60.0)
    moved = camera.viewmat[:3, :3] @ np.append(pose.move(right, up, forward).eye, 1.0)[:3] + camera.viewmat[:3, 3]
    np.testing.assert_allclose(moved, [right, -up, forward], atol=1e-4)


@settings(deadline=None)
@given(poses(), st.floats(0.01, 100.0))
def test_zooming_keeps_the_target(pose: Pose, factor: float) -> None:
    zoomed = pose.zoom(factor)
    np.testing.assert_allclose(zoomed.target, pose.target, atol=1e-9)
    assert zoomed.distance == pytest.approx(pose.distance * factor)
    assert (zoomed.yaw, zoomed.pitch) == (pose.yaw, pose.pitch)


@settings(deadline=None)
@given(poses(), UPS)
def test_another_up_keeps_eye_and_target(pose: Pose, up: Any) -> None:
    changed = pose.with_up(up)
    assert changed.up == pytest.approx(up)
    assert changed.eye == pytest.approx(pose.eye)
    if abs(changed.pitch) < PITCH_LIMIT - 1e-6:
        np.testing.assert_allclose(changed.target, pose.target, atol=1e-5)


def test_yaw_zero_looks_along_z_where_up_is_minus_y() -> None:
    np.testing.assert_allclose(Pose((0, 0, 0), 0.0, 0.0, 1.0).forward, [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(Pose((0, 0, 0), 0.0, 0.0, 1.0).right, [1, 0, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({"width": np.int64(64), "height": np.uint16(48), "fov_y": np.float32(40.0)}, None),
        ({"width": np.array(64)}, None),
        ({"width": 64.0}, "width must be a whole number, 1 to 16384, got 64.0"),
        ({"height": "48"}, "height must be a whole number, 1 to 16384, got '48'"),
        ({"height": 0}, "height must be 1 to 16384, got 0"),
        ({"fov_y": None}, "fov_y must be degrees, got None"),
        ({"fov_y": 1e-320}, "fov_y must be between 0 and 180 degrees"),
        ({"eye": "origin"}, "eye must be three finite numbers, got 'origin'"),
        ({"eye": [0, 0]}, "eye must be three finite numbers, got [0, 0]"),
        ({"target": [[0, 0], [0]]}, "target must be three finite numbers"),
        ({"up": np.zeros(3)}, "up must be three finite numbers, not all zero"),
    ],
)
def test_a_camera_takes_numbers_of_any_kind_and_says_what_else_it_was_given(
    changed: dict[str, object], expected: str | None
) -> None:
    usual = {"eye": (0, 0, -4), "target": (0, 0, 0), "up": (0, -1, 0), "width": 64, "height": 48, "fov_y": 40.0}
    if expected is None:
        found = Camera.look_at(**{**usual, **changed})
        assert (type(found.width), type(found.height)) == (int, int)
        assert np.allclose(found.K, Camera.look_at(**usual).K)
    else:
        with pytest.raises(CameraError, match=re.escape(expected)):
            Camera.look_at(**{**usual, **changed})


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("K", [[90, 0.5, 32], [0, 90, 24], [0, 0, 1]], "no skew"),
        ("K", [[90, 0, 0], [0, 90, 0], [32, 24, 1]], "transposed"),
        ("viewmat", np.eye(4) + np.eye(4, k=-3), "transposed"),
        ("K", "wide", "K must be finite with shape [3, 3], got 'wide'"),
        ("viewmat", [[1, 2], [3]], "viewmat must be finite with shape [4, 4]"),
        ("viewmat", None, "viewmat must be finite with shape [4, 4], got None"),
    ],
)
def test_matrices_that_are_no_cameras_are_refused(name: str, value: object, expected: str) -> None:
    usual = {"viewmat": np.eye(4), "K": [[90, 0, 32], [0, 90, 24], [0, 0, 1]], "width": 64, "height": 48}
    Camera(**usual)
    with pytest.raises(CameraError, match=re.escape(expected)):
        Camera(**{**usual, name: value})
