"""Scenes joined, and harmonics of another degree."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest

from tests.raster.compare import front_camera
from tests.scenes import random_gaussians
from tsplat import edit
from tsplat.raster.reference import rasterize
from tsplat.rendering import RenderOptions
from tsplat.scene import SH_COEFFICIENTS, Gaussians


def scene(n: int, sh_degree: int) -> Gaussians:
    return random_gaussians(np.random.default_rng(n), n, sh_degree)


def test_joined_scenes_follow_each_other_and_miss_nothing() -> None:
    first, second, third = scene(20, 1), scene(30, 3), scene(10, 0)
    joined = edit.join([first, second, third])
    for name in ("means", "quats", "scales", "opacities"):
        parts = [getattr(each, name) for each in (first, second, third)]
        assert np.array_equal(getattr(joined, name), np.concatenate(parts))
    assert joined.sh_degree == 3
    assert np.array_equal(joined.sh[:20, :4], first.sh)
    assert np.array_equal(joined.sh[20:50], second.sh)
    assert np.array_equal(joined.sh[50:, :1], third.sh)
    assert not joined.sh[:20, 4:].any()
    assert not joined.sh[50:, 1:].any()


def test_one_scene_joined_is_itself() -> None:
    alone = scene(5, 2)
    assert edit.join([alone]) is alone


@pytest.mark.parametrize("flags", [(False, False), (True, True, True), (True, False), (False, False, True)])
def test_a_joined_scene_is_antialiased_where_all_are_and_who_asks_is_warned_where_some_are(
    flags: tuple[bool, ...],
) -> None:
    scenes = [replace(scene(5, 0), antialiased=flag) for flag in flags]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert edit.join(scenes).antialiased == all(flags)
    assert len(caught) == (len(set(flags)) > 1)


def test_an_empty_scene_adds_nothing_but_its_degree() -> None:
    joined = edit.join([scene(5, 1), scene(5, 2).take([])])
    assert (len(joined), joined.sh_degree) == (5, 2)


@pytest.mark.parametrize("degree", [0, 1, 2, 3, 4])
def test_a_lower_degree_draws_what_the_renderer_draws_at_that_degree(degree: int) -> None:
    gaussians, camera = scene(40, 4), front_camera()
    lowered = edit.lower_sh_degree(gaussians, degree)
    assert lowered.sh.shape == (40, SH_COEFFICIENTS[degree], 3)
    asked = rasterize(gaussians, camera, RenderOptions(sh_degree=degree))
    np.testing.assert_array_equal(rasterize(lowered, camera, RenderOptions()).colors, asked.colors)


def test_no_degree_is_raised_by_lowering_it() -> None:
    gaussians = scene(5, 1)
    assert edit.lower_sh_degree(gaussians, 3) is gaussians


def test_harmonics_that_are_padded_change_no_picture() -> None:
    gaussians, camera = scene(40, 1), front_camera()
    padded = edit.with_sh_degree(gaussians, 3)
    assert padded.sh_degree == 3
    before, after = (rasterize(each, camera, RenderOptions()).colors for each in (gaussians, padded))
    np.testing.assert_array_equal(before, after)
