"""Fewer splats while the view moves, where there are more than a frame needs."""

from __future__ import annotations

import time

import numpy as np
import pytest

from tests.raster.compare import front_camera
from tests.scenes import random_gaussians
from tests.viewer.states import a_state
from tsplat._jit import JIT
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians
from tsplat.viewer.detail import Detail
from tsplat.viewer.picture import Painter
from tsplat.viewer.scenes import SceneVariants

pytestmark = pytest.mark.skipif(not JIT, reason="thousands of splats take minutes without a compiler")

N = 6000


@pytest.fixture(scope="module")
def scene() -> Gaussians:
    return random_gaussians(np.random.default_rng(0), N, 0)


def built(detail: Detail) -> Detail:
    """Wait until its levels are there."""
    end = time.monotonic() + 120.0
    while not detail.helps(detail.scene, front_camera()):
        assert time.monotonic() < end, "the levels never came"
        time.sleep(0.02)
    return detail


def test_a_scene_within_the_budget_is_left_alone(scene: Gaussians) -> None:
    assert not Detail(scene).helps(scene, front_camera())
    assert not Detail(scene, N).helps(scene, front_camera())


def test_a_budget_of_0_is_none(scene: Gaussians) -> None:
    assert not Detail(scene, 0).helps(scene, front_camera())


def test_a_frame_has_no_more_splats_than_the_budget_once_levels_are_built(scene: Gaussians) -> None:
    detail = Detail(scene, N // 4)
    assert detail.status(exact=True) == ""
    assert not detail.helps(scene, front_camera())
    assert detail.status(exact=True).startswith("building levels ")
    assert built(detail).draw(front_camera(), RenderOptions(depths=False)).visible <= 1.1 * N // 4
    assert detail.done == 1.0
    assert detail.status(exact=True) == ""
    assert detail.status(exact=False) == "merged"


def test_another_variant_of_the_scene_is_drawn_whole(scene: Gaussians) -> None:
    detail = built(Detail(scene, N // 4))
    assert not detail.helps(scene.take(range(N // 2)), front_camera())


def test_only_frames_that_need_not_be_exact_are_merged(scene: Gaussians) -> None:
    painter = Painter(SceneVariants(scene))
    painter.detail = built(Detail(scene, N // 4))
    state = a_state(output="half", total=N, kept=N)
    exact, merged = painter.draw(state), painter.draw(state, exact=False)
    assert exact.exact
    assert not merged.exact
    assert merged.visible < exact.visible / 2
    fewer = painter.draw(a_state(output="half", total=N, kept=N // 2), exact=False)
    assert fewer.exact
