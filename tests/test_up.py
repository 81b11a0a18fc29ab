"""Which way is up, by each cue: scenes of panels whose up is known, and those that must not be taken for them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.panels import chair, drone_scan, joined, mug, panel, relief, ring_of_cameras, room
from tsplat import edit
from tsplat.camera import Camera, Vector
from tsplat.framing import UPS, axis_name, guess_up
from tsplat.scene import Gaussians
from tsplat.train_views import TrainViews

FROM_Z = {
    "z": (0, 0, 0),
    "-z": (180, 0, 0),
    "-y": (90, 0, 0),
    "y": (-90, 0, 0),
    "x": (0, 90, 0),
    "-x": (0, -90, 0),
}
"""Degrees by which a scene whose up is z is turned, by what becomes of its up."""

USUAL = ("-y", "usual", "weak")


def told(gaussians: Gaussians, cameras: list[Camera] | None = None, *, spz: bool = False) -> tuple[str, str, str]:
    found = guess_up(gaussians, TrainViews.of(cameras) if cameras else None, spz=spz)
    return axis_name(found.direction), found.cue, found.sureness


def shelf() -> Gaussians:
    """Return boards one over the other: level at every height."""
    return joined(*(panel((0, y, 0), (2, 0, 0), (0, 0, 1), side=20) for y in range(5)))


@pytest.mark.parametrize("up", FROM_Z)
def test_a_wide_flat_ground_is_below_whichever_axis_is_up(up: str) -> None:
    assert told(edit.rotate(drone_scan(), FROM_Z[up])) == (up, "ground", "sure")


def test_land_may_have_a_ditch_but_none_as_deep_as_the_houses_are_high() -> None:
    assert told(drone_scan(0.5)) == ("z", "ground", "sure")
    assert told(drone_scan(1.5)) == USUAL


@pytest.mark.parametrize(
    "no_ground",
    [chair, shelf, relief, lambda: room(4.0, 4.0, 4.0), lambda: panel((0, 0, 0), (0, 1, 0), (0, 0, 1))],
    ids=["chair's back", "shelf", "relief", "cube", "wall"],
)
def test_level_surface_that_is_no_ground_says_nothing(no_ground: Callable[[], Gaussians]) -> None:
    assert told(no_ground()) == USUAL


@pytest.mark.parametrize("turn", FROM_Z)
def test_a_chair_turned_any_way_stands_on_nothing(turn: str) -> None:
    assert told(edit.rotate(chair(), FROM_Z[turn])) == USUAL


def test_a_room_scanned_with_z_up_has_floor_ceiling_and_walls() -> None:
    assert told(room()) == ("z", "room", "likely")
    assert told(edit.rotate(room(), FROM_Z["y"])) == USUAL  # as a trainer has it, -y: nothing to add
    assert told(room(floor=False)) == USUAL


@pytest.mark.parametrize("up", [(0, -1, 0), (0, 0, 1), (1, 0, 0), (0.3, -0.9, 0.2)])
def test_cameras_held_level_outweigh_the_ground(up: Vector) -> None:
    found = guess_up(drone_scan(), TrainViews.of(ring_of_cameras((0, 0, 1), 3.0, up)))
    assert (found.cue, found.sureness) == ("cameras", "sure")
    np.testing.assert_allclose(found.direction, np.divide(up, np.linalg.norm(up)), atol=1e-4)


def test_cameras_a_few_degrees_off_an_axis_mean_the_axis() -> None:
    assert told(chair(), ring_of_cameras((0, 0, 1), 3.0, (0.03, 0.0, 1.0)))[0] == "z"


def rolled(cameras: list[Camera], degrees: float) -> list[Camera]:
    turn = np.eye(4)
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn[:2, :2] = [[cos, -sin], [sin, cos]]
    return [Camera(turn @ each.viewmat, each.K, each.width, each.height) for each in cameras]


@pytest.mark.parametrize(
    "cameras",
    [
        [],
        ring_of_cameras((0, 0, 1), 3.0, (0, 0, 1))[:2],
        ring_of_cameras((0, 0, 1), 3.0, (0, 1, 0))[:1] * 5,
        [Camera.look_at((0, -1, 3), (0, 0, 0), (0, 0, 1), width=300, height=200, fov_y=50.0)] * 5,
        rolled(ring_of_cameras((0, 0, 1), 3.0, (0, 0, 1)), 90.0),
    ],
    ids=["none", "two", "one place", "from above", "on their side"],
)
def test_cameras_that_do_not_tell_are_passed_over(cameras: list[Camera]) -> None:
    assert told(drone_scan(), cameras) == ("z", "ground", "sure")


def test_cameras_without_sense_are_passed_over() -> None:
    frusta = np.zeros((9, 3, 4), np.float32)
    frusta[:3], frusta[3:6], frusta[6:] = np.inf, np.nan, 1e-30
    assert guess_up(drone_scan(), TrainViews(frusta)).cue == "ground"


def test_only_an_spz_is_taken_to_stand_on_its_head() -> None:
    assert told(mug(1.0), spz=True) == ("y", "light and detail", "likely")
    assert guess_up(mug(1.0), spz=True).spz_frame
    assert told(mug(-1.0), spz=True) == told(mug(1.0)) == USUAL


@pytest.mark.parametrize(("up", "turned"), [("y", True), ("-y", False), ("z", False)])
def test_an_spz_whose_ground_is_above_has_the_axes_of_a_ply(up: str, turned: bool) -> None:
    found = guess_up(edit.rotate(drone_scan(), FROM_Z[up]), spz=True)
    assert (axis_name(found.direction), found.cue, found.spz_frame) == (up, "ground", turned)


def test_detail_alone_turns_no_spz() -> None:
    grey = mug(1.0)
    grey = replace(grey, sh=np.zeros_like(grey.sh))
    assert told(grey, spz=True) == USUAL


def test_what_is_said_of_a_guess_names_the_way_out_where_it_is_weak() -> None:
    assert guess_up(drone_scan()).text == "z, sure: there is a ground"
    assert guess_up(chair()).text == "-y, weak: the usual, nothing in the scene tells; --up says it"
    assert [axis_name(up) for up in UPS] == ["-y", "y", "z", "-z", "x", "-x"]
    assert axis_name((0.6, 0.8, 0.0)) == "0.6 0.8 0"
