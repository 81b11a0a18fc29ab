"""The path of an orbit: closed, even, and the way the viewer goes around."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.scenes import random_gaussians
from tests.viewer.states import START, a_state
from tsplat.record.orbit import Orbit
from tsplat.rendering import RenderOptions
from tsplat.viewer.state import AUTO_ORBIT, Tick
from tsplat.viewer.update import update

GAUSSIANS = random_gaussians(np.random.default_rng(4), 60, sh_degree=0)


def orbit(count: int = 12, turns: int = 1, size: tuple[int, int] = (32, 24)) -> Orbit:
    return Orbit(GAUSSIANS, RenderOptions(depths=False), START, (32, 24), size, 55.0, count, turns)


@pytest.mark.parametrize("turns", [1, 2, -1])
def test_the_frame_after_the_last_would_be_the_first(turns: int) -> None:
    frames = orbit(turns=turns)
    assert len(frames) == 12
    assert np.allclose(frames.camera(12).viewmat, frames.camera(0).viewmat, atol=1e-9)
    assert not np.allclose(frames.camera(11).viewmat, frames.camera(0).viewmat, atol=1e-2)


def test_steps_are_even_and_keep_the_target_in_the_middle() -> None:
    frames = orbit()
    eyes = np.array([frames.camera(index).eye for index in range(13)])
    steps = np.linalg.norm(np.diff(eyes, axis=0), axis=1)
    assert steps == pytest.approx(np.full(12, steps[0]))
    assert steps[0] > 0.1
    for index in range(12):
        camera = frames.camera(index)
        x, y, depth = camera.viewmat[:3, :3] @ START.target + camera.viewmat[:3, 3]
        assert (x, y, depth) == pytest.approx((0.0, 0.0, START.distance), abs=1e-9)


def test_it_goes_around_as_the_viewer_does() -> None:
    state = update(a_state(auto_orbit=True), Tick(0.5))
    count = round(360 / (0.5 * AUTO_ORBIT))
    assert np.allclose(orbit(count).camera(1).eye, state.pose.eye)
    assert not np.allclose(orbit(count, -1).camera(1).eye, state.pose.eye)
    assert np.allclose(orbit(count, -1).camera(1).eye, orbit(count).camera(count - 1).eye)


def test_two_turns_are_each_half_as_long() -> None:
    assert np.allclose(orbit(12, 2).camera(3).viewmat, orbit(12, 1).camera(6).viewmat)
    assert np.allclose(orbit(12, 0).camera(7).viewmat, orbit(12).camera(0).viewmat)


def test_frames_of_other_proportions_are_the_same_view_stretched() -> None:
    wide, square = orbit(), orbit(size=(24, 24))
    assert square[3].shape == (24, 24, 3)
    assert square.camera(3).K[0, 0] == pytest.approx(wide.camera(3).K[0, 0] * 24 / 32)
    assert square.camera(3).K[1, 1] == pytest.approx(wide.camera(3).K[1, 1])


def test_frames_show_the_scene_from_their_side() -> None:
    frames = orbit()
    assert frames[0].max() > 50
    assert np.abs(frames[0].astype(int) - frames[6]).mean() > 2
    assert math.isclose(frames.camera(0).fov_y, 55.0)
