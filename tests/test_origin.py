"""Scenes far from the world's origin: what is taken off, and that every edit knows of it."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from tests.raster.compare import psnr
from tests.scenes import random_gaussians
from tsplat import cli, edit, io
from tsplat.camera import Camera
from tsplat.errors import LoadWarning, SceneError
from tsplat.framing import bulk
from tsplat.options import near_plane
from tsplat.origin import find_origin, placed, world_means
from tsplat.rendering import NEAR_PLANE
from tsplat.scene import Gaussians

UTM = np.array([448262.4, 5411034.25, 312.0])
CLOUD = random_gaussians(np.random.default_rng(5), 500, 1)


def far() -> Gaussians:
    return edit.translate(CLOUD, UTM)


@pytest.mark.parametrize(
    ("middle", "size", "origin"),
    [
        ((0, 0, 0), 1.0, None),
        ((500, -300, 20), 1.0, None),
        ((2e4, 0, 0), 2e4, None),
        ((448262.4, 5411034.25, 312.0), 1.0, (448300.0, 5411000.0, 300.0)),
        ((448262.4, 5411034.25, 312.0), 300.0, (450000.0, 5410000.0, 0.0)),
        ((0.5, 0, 0), 1e-5, (0.5, 0.0, 0.0)),
        ((-4510000.25, 1234567.5, 4320000.75), 10.0, (-4510000.0, 1235000.0, 4320000.0)),
        ((1e38, 0, 0), 1.0, None),
    ],
)
def test_an_origin_is_found_where_float32_would_lose_detail_and_is_round(
    middle: tuple[float, ...], size: float, origin: tuple[float, ...] | None
) -> None:
    points = np.array(middle) + size * np.random.default_rng(1).uniform(-1, 1, (20_000, 3))
    points[7] = np.nan
    assert find_origin(points) == origin


@pytest.mark.parametrize("count", [0, 1])
def test_hardly_any_splats_need_no_origin(count: int) -> None:
    assert find_origin(np.full((count, 3), 1e6)) is None


def test_moving_to_far_coordinates_and_back_loses_nothing() -> None:
    there = far()
    assert there.origin == (448300.0, 5411000.0, 300.0)
    assert np.abs(there.means).max() < 100.0
    back = edit.translate(there, -UTM)
    assert back.origin is None
    np.testing.assert_allclose(back.means, CLOUD.means, atol=5e-6)


@pytest.mark.parametrize(
    ("there", "here"),
    [
        (lambda s: edit.crop_box(s, UTM - 0.4, UTM + 0.5), lambda s: edit.crop_box(s, [-0.4] * 3, [0.5] * 3)),
        (lambda s: edit.crop_sphere(s, UTM, 0.5), lambda s: edit.crop_sphere(s, (0, 0, 0), 0.5)),
        (lambda s: edit.drop_faint(s, 0.5), lambda s: edit.drop_faint(s, 0.5)),
        (lambda s: edit.keep_most_important(s, 9), lambda s: edit.keep_most_important(s, 9)),
        (lambda s: edit.join([s, s]), lambda s: edit.join([s, s])),
    ],
)
def test_an_edit_there_does_what_it_does_here(there, here) -> None:  # type: ignore[no-untyped-def]  # of lambdas
    np.testing.assert_allclose(world_means(there(far())) - UTM, here(CLOUD).means, atol=5e-6)


def test_turns_and_scales_go_about_the_origin_of_the_world() -> None:
    turned, scaled = edit.rotate(far(), (0, 0, 90)), edit.scale(far(), 3.0)
    x, y, z = UTM
    np.testing.assert_allclose(
        world_means(turned), CLOUD.means[:, [1, 0, 2]] * [-1, 1, 1] + [-y, x, z], rtol=0, atol=1e-5
    )
    np.testing.assert_allclose(world_means(scaled), 3.0 * (CLOUD.means + UTM), rtol=0, atol=2e-5)


def test_a_turn_takes_what_is_up_along() -> None:
    assert edit.rotate(replace(CLOUD, up=(0.0, 0.0, 1.0)), (90, 0, 0)).up == (0.0, -1.0, 0.0)


def test_joined_scenes_far_from_each_other_are_put_together_and_the_worse_placed_is_named() -> None:
    beside = edit.join([far(), edit.translate(CLOUD, np.add(UTM, (50, 0, 0)))])
    assert beside.origin
    np.testing.assert_allclose(world_means(beside)[len(CLOUD)] - UTM, CLOUD.means[0] + [50, 0, 0], atol=1e-5)
    with pytest.warns(LoadWarning, match=r"scene 2 of 2 lies so far .* in steps of 0\.5"):
        apart = edit.join([far(), CLOUD.take(range(400))])
    np.testing.assert_allclose(world_means(apart)[: len(CLOUD)], world_means(far()), atol=1e-5)


def test_joined_scenes_have_the_up_that_they_agree_on() -> None:
    z, y = replace(CLOUD, up=(0.0, 0.0, 1.0)), replace(CLOUD, up=(0.0, 1.0, 0.0))
    assert edit.join([z, CLOUD, z]).up == z.up
    with pytest.warns(LoadWarning, match="2 of 2 scenes say what is up, and not the same"):
        assert edit.join([z, y]).up is None


def test_a_camera_of_the_world_sees_the_same() -> None:
    camera = Camera.look_at(UTM - [0, 0, 4], UTM, (0, -1, 0), width=64, height=48, fov_y=50.0)
    scene = far()
    assert scene.origin
    shifted = camera.shifted(scene.origin)
    np.testing.assert_allclose(shifted.eye + scene.origin, UTM - [0, 0, 4], atol=1e-6)
    depths = scene.means @ shifted.viewmat[2, :3] + shifted.viewmat[2, 3]
    np.testing.assert_allclose(depths, CLOUD.means[:, 2] + 4.0, atol=1e-5)


@pytest.mark.parametrize("about", [{"up": (0, 0, 0)}, {"up": (0, np.nan, 1)}, {"origin": (np.inf, 0, 0)}])
def test_what_is_no_vector_is_refused(about: dict[str, tuple[float, ...]]) -> None:
    with pytest.raises(SceneError, match=next(iter(about))):
        replace(CLOUD, **about)  # type: ignore[arg-type]  # that is what is tried


def test_pickling_keeps_all() -> None:
    scene = replace(far(), up=(0.0, 0.0, 1.0), antialiased=True)
    twin = pickle.loads(pickle.dumps(scene))
    assert (twin.origin, twin.up, twin.antialiased) == (scene.origin, scene.up, True)


@pytest.mark.parametrize("factor", [1e-6, 1e-3, 1.0, 1e4])
def test_lengths_are_relative_to_the_scene(factor: float) -> None:
    scene = edit.scale(CLOUD, factor)
    assert bulk(scene).radius == pytest.approx(factor * bulk(CLOUD).radius, rel=1e-3)
    assert near_plane(scene) == pytest.approx(NEAR_PLANE * min(1.0, bulk(scene).radius))
    assert near_plane(edit.scale(scene, 2.0 / factor)) == NEAR_PLANE


def test_an_ordinary_scene_that_is_placed_again_stays_as_it_is() -> None:
    twin = placed(CLOUD, world_means(CLOUD))
    assert twin.origin is None
    np.testing.assert_array_equal(twin.means, CLOUD.means)


def test_a_person_says_places_in_the_world(tmp_path: Path) -> None:
    pictures: list[npt.NDArray[np.float32]] = []
    for scene, at in ((CLOUD, np.zeros(3)), (far(), UTM)):
        path = io.save(tmp_path / f"{len(pictures)}.ply", scene)
        eye, target = (" ".join(map(str, at + place)) for place in ((0.5, -0.2, -4.0), (0.1, 0.0, 0.2)))
        out = tmp_path / f"{len(pictures)}.npy"
        command = [
            "render",
            str(path),
            "-o",
            str(out),
            "--width",
            "80",
            "--height",
            "60",
            "--antialias",
            "classic",
        ]
        assert cli.main([*command, "--up=0,-1,0", f"--eye={eye}", f"--target={target}"]) == 0
        pictures.append(np.load(out))
    assert np.ptp(pictures[0]) > 0.5
    assert psnr(*pictures) > 60.0


def test_training_cameras_are_where_the_world_has_them(tmp_path: Path) -> None:
    camera = {"width": 100, "height": 80, "fx": 90.0, "fy": 90.0, "rotation": np.eye(3).tolist()}
    views = []
    for at, origin in ((np.zeros(3), None), (UTM, (448300.0, 5411000.0, 300.0))):
        cameras = [camera | {"position": (at + place).tolist()} for place in ((0, 0, -4), (1, 2, -3))]
        (tmp_path / "cameras.json").write_text(json.dumps(cameras))
        views.append(io.training_beside(tmp_path / "scene.ply", origin).views)
    here, there = views
    assert here
    assert there
    place = np.array([0.3, 0.1, 0.5])
    local = np.append(place + UTM - (448300.0, 5411000.0, 300.0), 1.0)
    np.testing.assert_allclose(there.frusta @ local, here.frusta @ np.append(place, 1.0), atol=1e-4)
