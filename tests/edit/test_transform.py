"""A scene that was moved, seen by a camera that moved along."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from tests.raster.compare import front_camera, psnr
from tests.scenes import random_gaussians
from tsplat import edit
from tsplat.camera import Camera
from tsplat.edit.transform import euler_quat
from tsplat.errors import OptionError, SceneError
from tsplat.raster import rasterize
from tsplat.rendering import RenderOptions
from tsplat.rotations import rotations_of
from tsplat.scene import Gaussians

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]


@pytest.fixture(scope="module")
def cloud() -> Gaussians:
    return random_gaussians(np.random.default_rng(6), 300, sh_degree=4)


def euler(x: float, y: float, z: float) -> F64:
    """Return the rotation about x, then y, then z by degrees, written out."""
    (sx, sy, sz), (cx, cy, cz) = np.sin(np.radians([x, y, z])), np.cos(np.radians([x, y, z]))
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_y @ about_x)


def moved(camera: Camera, rotation: F64, factor: float, offset: F64) -> Camera:
    """Return the camera that sees of ``factor * rotation @ x + offset`` what ``camera`` sees of x."""
    viewmat = np.eye(4)
    viewmat[:3, :3] = camera.viewmat[:3, :3] @ rotation.T
    viewmat[:3, 3] = factor * camera.viewmat[:3, 3] - viewmat[:3, :3] @ offset
    return replace(camera, viewmat=viewmat)


def pictures(before: Gaussians, after: Gaussians, camera: Camera, camera_after: Camera) -> tuple[F32, F32]:
    options = RenderOptions(threads=1)
    one = rasterize(before, camera, options).colors
    return one, rasterize(after, camera_after, options).colors


@pytest.mark.parametrize(
    "degrees", [(0, 0, 0), (90, 0, 0), (0, -90, 0), (0, 0, 180), (30, -50, 110), (400, 1, -7)]
)
def test_a_turned_scene_looks_the_same_to_a_camera_that_turned_along(
    cloud: Gaussians, degrees: tuple[float, float, float]
) -> None:
    camera = front_camera(160, 120)
    turned = edit.rotate(cloud, degrees)
    one, other = pictures(cloud, turned, camera, moved(camera, euler(*degrees), 1.0, np.zeros(3)))
    assert psnr(one, other) > 50
    np.testing.assert_allclose(np.linalg.norm(turned.quats, axis=1), 1.0, atol=1e-6)


def test_the_harmonics_turn_too(cloud: Gaussians) -> None:
    camera = front_camera(160, 120)
    camera_after = moved(camera, euler(30, -50, 110), 1.0, np.zeros(3))
    stiff = replace(edit.rotate(cloud, (30, -50, 110)), sh=cloud.sh)
    assert psnr(*pictures(cloud, stiff, camera, camera_after)) < 35


def test_a_scaled_and_a_shifted_scene_look_the_same_to_a_camera_that_went_along(cloud: Gaussians) -> None:
    camera, offset = front_camera(160, 120), np.array([3.0, -2.0, 7.0])
    scaled = edit.scale(cloud, 2.5)
    assert psnr(*pictures(cloud, scaled, camera, moved(camera, np.eye(3), 2.5, np.zeros(3)))) > 50
    shifted = edit.translate(cloud, offset)
    assert psnr(*pictures(cloud, shifted, camera, moved(camera, np.eye(3), 1.0, offset))) > 50


def test_edits_are_made_one_after_the_other(cloud: Gaussians) -> None:
    camera, offset = front_camera(160, 120), np.array([1.0, 2.0, -0.5])
    after = edit.translate(edit.scale(edit.rotate(cloud, (20, 40, 60)), 0.5), offset)
    assert psnr(*pictures(cloud, after, camera, moved(camera, euler(20, 40, 60), 0.5, offset))) > 50


@pytest.mark.parametrize(("degrees", "of_x", "of_y"), [
    ((0, 0, 90), (0, 1, 0), (-1, 0, 0)),
    ((90, 0, 0), (1, 0, 0), (0, 0, 1)),
    ((0, 90, 0), (0, 0, -1), (0, 1, 0)),
    ((90, 0, 90), (0, 1, 0), (0, 0, 1)),  # y goes to z, which the turn about z leaves alone
])  # fmt: skip
def test_a_quarter_turn_goes_counterclockwise_and_x_comes_before_z(
    cloud: Gaussians, degrees: tuple[float, float, float], of_x: tuple[int, ...], of_y: tuple[int, ...]
) -> None:
    axes = replace(cloud.take([0, 1]), means=np.eye(3, dtype=np.float32)[:2])
    np.testing.assert_allclose(edit.rotate(axes, degrees).means, [of_x, of_y], atol=1e-6)


def test_a_quat_is_the_matrix_that_is_written_out() -> None:
    for degrees in np.random.default_rng(0).uniform(-400, 400, (20, 3)):
        quat = euler_quat(degrees)
        assert math.isclose(np.linalg.norm(quat), 1.0)
        np.testing.assert_allclose(rotations_of(quat[None])[0], euler(*degrees), atol=1e-12)


def test_turning_back_gives_the_same_scene(cloud: Gaussians) -> None:
    back = edit.rotate(edit.rotate(cloud, (0, 0, 70)), (0, 0, -70))
    for name in ("means", "quats", "sh"):
        np.testing.assert_allclose(getattr(back, name), getattr(cloud, name), atol=2e-6)


@pytest.mark.parametrize("factor", [0.0, -1.0, math.nan])
def test_a_scale_that_turns_inside_out_or_to_nothing_is_refused(cloud: Gaussians, factor: float) -> None:
    with pytest.raises(OptionError, match="above 0"):
        edit.scale(cloud, factor)


@pytest.mark.filterwarnings("ignore:overflow")
def test_a_scene_that_outgrows_float32_is_refused(cloud: Gaussians) -> None:
    with pytest.raises(SceneError, match="means must be finite"):
        edit.translate(cloud, (1e39, 0, 0))


def test_an_empty_scene_can_be_moved(cloud: Gaussians) -> None:
    assert len(edit.translate(edit.scale(edit.rotate(cloud.take([]), (1, 2, 3)), 2), (1, 1, 1))) == 0
