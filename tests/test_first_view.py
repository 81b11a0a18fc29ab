"""The first view: from the side that shows most, never from inside a floater, in a room as it was taken."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from tests.panels import ball, colored, drone_scan, guitar, joined, panel, relief, ring_of_cameras, room
from tests.scenes import random_gaussians
from tsplat import edit
from tsplat.camera import Pose
from tsplat.first_view import FirstView, first_view, marked, score, where_to_stand
from tsplat.framing import start_pose
from tsplat.framing.sample import sample
from tsplat.framing.trim import trimmed
from tsplat.lod import open_stored
from tsplat.lod.stored import store
from tsplat.rendering import RenderOptions
from tsplat.scene import SH_C0, Gaussians
from tsplat.train_views import TrainViews

OPTIONS = RenderOptions(antialias="relative", depths=False)
HOW: dict[str, Any] = {"aspect": 1.5, "fov_y": 55.0}


def turn_of(view: FirstView, gaussians: Gaussians) -> int:
    """Return how many quarters of a turn the view is away from where geometry alone would stand."""
    plain = start_pose(gaussians, **HOW, up=view.pose.up)
    return round(math.remainder(view.pose.yaw - plain.yaw, 2 * math.pi) / (math.pi / 2)) % 4


@pytest.mark.parametrize("degrees", [0, 90, 180, 270])
def test_a_relief_is_seen_from_the_front_whichever_way_that_is(degrees: int) -> None:
    scene = edit.rotate(relief(), (0, degrees, 0))
    front = edit.rotate(ball((0, 0, 1), 0.0, 0.1, (1, 1, 1), 1), (0, degrees, 0)).means[0]
    view = first_view(scene, OPTIONS, **HOW)
    assert -view.pose.forward @ front > 0.7


def test_the_eye_does_not_begin_inside_a_floater() -> None:
    thing = random_gaussians(np.random.default_rng(2), 3000)
    eye = start_pose(thing, **HOW).eye
    scene = joined(_plain(thing), ball(eye, 0.05, 0.3, (0.6, 0.5, 0.2), 20))
    assert np.linalg.norm(np.subtract(start_pose(scene, **HOW).eye, eye)) < 0.2
    view = first_view(scene, OPTIONS, **HOW)
    assert turn_of(view, scene) != 0
    assert np.linalg.norm(np.subtract(view.pose.eye, eye)) > 1.0


def test_what_is_nearer_than_a_third_of_the_way_to_the_middle_is_marked() -> None:
    pose = Pose.look_at((0.0, 0.0, -4.0), (0.0, 0.0, 0.0), (0.0, -1.0, 0.0))
    depths = np.array([-1.0, 0.5, 1.3, 1.5, 4.0, 9.0])
    row = colored(np.stack([0 * depths, 0 * depths, depths - 4.0], axis=1), (0.1,) * 3, (0.2, 0.6, 0.9))
    red, green, blue = (0.5 + SH_C0 * marked(row, pose).sh[:, 0]).T
    np.testing.assert_allclose(green, [1, 1, 1, 0, 0, 0], atol=1e-6)
    np.testing.assert_allclose(red, 0.2126 * 0.2 + 0.7152 * 0.6 + 0.0722 * 0.9, atol=1e-6)
    np.testing.assert_allclose(blue, 0.0, atol=1e-6)


@pytest.mark.parametrize("scene", [lambda: random_gaussians(np.random.default_rng(2), 3000), drone_scan, guitar])
def test_where_all_sides_are_alike_the_usual_one_is_kept(scene: Any) -> None:
    gaussians = scene()
    view = first_view(gaussians, OPTIONS, **HOW)
    assert view.pose == where_to_stand(gaussians, OPTIONS, **HOW).pose
    assert view == first_view(gaussians, OPTIONS, **HOW)


def test_the_start_view_of_a_drone_scan_stands_over_the_ground() -> None:
    pose = first_view(drone_scan(), OPTIONS, **HOW).pose
    assert pose.up == (0.0, 0.0, 1.0)
    assert pose.eye[2] > 0.0
    assert -0.5 < pose.forward[2] < -0.1


def test_a_thin_part_that_hangs_together_with_the_bulk_is_in_the_frame() -> None:
    scene = guitar()
    camera = first_view(scene, OPTIONS, **HOW).pose.camera(240, 160, 55.0)
    tip = camera.viewmat @ (0.0, -5.0, 0.0, 1.0)
    across, down = tip[:2] / tip[2]
    half = math.tan(math.radians(55.0 / 2))
    assert abs(down) < half
    assert abs(across) < 1.5 * half


def needles(count: int, first: float = 1.0, opacity: float = 0.95) -> Gaussians:
    """Return so many rows of splats that go out from the origin in as many directions of a plane."""
    turns = 2.0 * np.pi * np.repeat(np.arange(count), 60) / count
    lengths = np.tile(np.linspace(first, 4.5, 60), count)
    places = np.stack([lengths * np.cos(turns), 0 * turns, lengths * np.sin(turns)], axis=1)
    return colored(places, (0.06,) * 3, (0.3, 0.2, 0.1), opacity)


@pytest.mark.parametrize(
    ("beside", "reaches"),
    [
        (needles(1), True),
        (needles(3), True),
        (needles(12), False),
        (needles(1, 3.5), False),
        (needles(1, opacity=0.1), False),
    ],
    ids=["a needle", "three", "all around", "apart", "see-through"],
)
def test_a_thin_opaque_part_that_hangs_together_with_the_bulk_belongs_to_it(
    beside: Gaussians, reaches: bool
) -> None:
    body = ball((0.0, 0.0, 0.0), 1.0, 0.08, (0.6, 0.4, 0.2), 3000)
    farthest = float(np.linalg.norm(trimmed(sample(joined(body, beside))).means, axis=1).max())
    assert (farthest > 4.0) == reaches
    assert reaches or farthest < 2.7


def test_in_a_room_the_view_is_that_of_a_training_camera() -> None:
    cameras = ring_of_cameras((3.0, 3.0, 1.5), 0.8, (0.0, 0.0, 1.0), outwards=True)
    view = first_view(room(), RenderOptions(train_views=TrainViews.of(cameras)), **HOW)
    assert view.pose in view.cameras
    assert view.pose.up == (0.0, 0.0, 1.0)
    eyes, ahead = np.array([each.eye for each in cameras]), np.array([each.viewmat[2, :3] for each in cameras])
    nearest = int(np.argmin(np.linalg.norm(eyes - view.pose.eye, axis=1)))
    np.testing.assert_allclose(view.pose.eye, eyes[nearest], atol=1e-3)
    np.testing.assert_allclose(view.pose.forward, ahead[nearest], atol=1e-3)


def test_of_the_cameras_in_a_room_that_one_is_taken_whose_view_shows_most() -> None:
    from_corners = ring_of_cameras((3.0, 3.0, 1.5), 0.8, (0.0, 0.0, 1.0), outwards=True, count=8)
    at_walls = [each for each in from_corners if np.abs(each.viewmat[2, :2]).max() > 0.99]
    stripes = panel((5.9, 0.0, 0.0), (0, 6, 0), (0, 0, 2.5), (1, 1, 1), checks=20)
    paper = panel((0.1, 0.0, 0.0), (0, 6, 0), (0, 0, 2.5), side=60)  # more splats, and less to see
    striped = joined(room(), stripes, paper)
    for cameras in (from_corners, at_walls[::-1], at_walls):
        view = first_view(striped, RenderOptions(train_views=TrainViews.of(cameras)), **HOW)
        assert view.pose.forward[0] > 0.5


def test_around_a_thing_the_view_is_no_training_cameras_but_from_their_side() -> None:
    thing = random_gaussians(np.random.default_rng(2), 3000)
    around = RenderOptions(train_views=TrainViews.of(ring_of_cameras((0, 0, 0), 4.0, (0, -1, 0))))
    assert not first_view(thing, around, **HOW).cameras
    behind = [each for each in ring_of_cameras((0, 0, 0), 4.0, (0, -1, 0), count=60) if each.eye[2] > 3.0]
    view = first_view(thing, RenderOptions(train_views=TrainViews.of(behind)), **HOW)
    assert view.pose.eye[2] > 2.0


def test_what_a_person_says_is_up_is_up() -> None:
    view = first_view(drone_scan(), OPTIONS, **HOW, up=(0.0, -1.0, 0.0))
    assert (view.pose.up, view.up.cue) == ((0.0, -1.0, 0.0), "said")


@pytest.mark.parametrize("count", [0, 1, 3])
def test_scenes_of_next_to_nothing_have_a_first_view(count: int) -> None:
    nothing = random_gaussians(np.random.default_rng(0), count)
    assert np.isfinite(first_view(nothing, OPTIONS, **HOW).pose.eye).all()


def test_a_scene_on_disk_begins_as_it_does_in_memory(tmp_path: Path) -> None:
    scene = edit.rotate(relief(), (0, 180, 0))
    with (tmp_path / "relief.tsplat").open("w+b") as file:
        store(file, scene, 1, lambda _: None)
    stored = first_view(open_stored(tmp_path / "relief.tsplat"), OPTIONS, **HOW)
    loaded = first_view(scene, OPTIONS, **HOW)
    assert turn_of(stored, scene) == turn_of(loaded, scene)
    np.testing.assert_allclose(stored.pose.eye, loaded.pose.eye, atol=0.01)


def test_a_picture_scores_by_its_edges_less_what_is_in_the_way() -> None:
    def picture(stripes: int, near: float) -> npt.NDArray[np.float32]:
        colors = np.zeros((16, 16, 3), np.float32)
        colors[:, :, 0] = np.arange(16) // (16 // stripes) % 2
        colors[: round(16 * near), :, 1] = 1.0
        return colors

    assert score(picture(8, 0.0)) > score(picture(2, 0.0)) > 0.0
    assert score(picture(8, 0.5)) == pytest.approx(0.5 * score(picture(8, 0.0)))
    assert score(picture(8, 1.0)) == 0.0


def test_a_tilted_up_keeps_the_front() -> None:
    scene = random_gaussians(np.random.default_rng(2), 500)
    level, tilted = (start_pose(scene, **HOW, up=up) for up in ((0, -1, 0), (-0.05, -0.9, -0.43)))
    assert level.forward[2] > 0.8
    assert tilted.forward[2] > 0.8


def _plain(gaussians: Gaussians) -> Gaussians:
    return Gaussians(gaussians.means, gaussians.quats, gaussians.scales, gaussians.opacities, gaussians.sh[:, :1])
