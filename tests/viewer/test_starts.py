"""Where a session begins, what it says of that, and the key that turns the scene."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.panels import chair, drone_scan, mug, relief
from tests.viewer.states import a_state
from tsplat.framing import UPS, start_pose
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians
from tsplat.terminal.keys import Key
from tsplat.viewer.starts import GREETING, GUESSED, TURNED, Starts, greeting, next_up
from tsplat.viewer.state import ViewerState, picture
from tsplat.viewer.update import update

ASPECT = 80 * 10 / (24 * 20)
OPTIONS = RenderOptions(antialias="relative", depths=False)


def begun(scene: Gaussians, **how: Any) -> tuple[Starts, ViewerState]:
    starts = Starts(scene, OPTIONS, aspect=ASPECT, fov_y=55.0, **how)
    return starts, a_state(pose=starts.first.pose, start=starts.first.pose, output="half")


def test_u_asks_for_the_next_up_once_for_each_press_and_draws_nothing_else() -> None:
    state = a_state()
    asked = update(update(state, Key("u")), Key("U"))
    assert (state.ups, asked.ups) == (0, 2)
    assert picture(asked) == picture(state)
    assert update(asked, Key("u", "release")).ups == 2


def test_six_presses_go_through_all_ups_and_come_back() -> None:
    starts, state = begun(chair())
    seen = []
    for _ in UPS:
        state = starts.turned(state)
        seen.append(state.pose.up)
        assert state.pose == state.start
    assert set(seen) == set(UPS)
    assert seen[-1] == (0.0, -1.0, 0.0)
    assert "--up -y" in state.message


def test_after_a_tilted_up_comes_what_follows_the_axis_nearest_to_it() -> None:
    assert next_up((-0.05, -0.9, -0.43)) == next_up((0.0, -1.0, 0.0)) == (0.0, 1.0, 0.0)
    assert next_up((-1.0, 0.0, 0.0)) == (0.0, -1.0, 0.0)


def test_a_session_begins_at_the_side_that_shows_most_unless_a_key_was_there_first() -> None:
    scene = relief()  # its back is where the view would begin
    starts, state = begun(scene)
    plain = start_pose(scene, aspect=ASPECT, fov_y=55.0)
    assert state.pose == plain
    moved = replace(state, pose=plain.orbit(0.1, 0.0))
    settled, kept = starts.settled(state), starts.settled(moved)
    assert np.dot(settled.pose.forward, plain.forward) < -0.5
    assert kept.pose == moved.pose
    assert settled.pose == settled.start == kept.start
    assert settled.radius == pytest.approx(0.5 * settled.pose.distance)


@pytest.mark.parametrize(
    ("scene", "how", "said"),
    [
        (drone_scan, {}, GREETING),
        (chair, {}, GUESSED),
        (chair, {"up": (0.0, 0.0, 1.0)}, GREETING),
        (lambda: mug(1.0), {"spz": True}, TURNED),
        (lambda: mug(1.0), {}, GUESSED),
    ],
    ids=["a ground", "a guess", "said", "an SPZ on its head", "a PLY"],
)
def test_the_first_line_says_what_was_guessed_and_the_way_out(scene: Any, how: dict[str, Any], said: str) -> None:
    starts, _ = begun(scene(), **how)
    assert greeting(starts.first.up) == said


def test_what_is_said_fits_beside_what_else_the_last_row_may_show() -> None:
    assert all(len(text) < 70 for text in (GREETING, GUESSED, TURNED))
    assert "--up" in GUESSED
    assert "--spz-frame rdf" in TURNED
