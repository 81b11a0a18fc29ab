"""Crops and filters, splat by splat."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import numpy as np
import pytest

from tests.scenes import random_gaussians
from tsplat import edit
from tsplat.errors import OptionError
from tsplat.importance import importance
from tsplat.scene import Gaussians


@pytest.fixture(scope="module")
def cloud() -> Gaussians:
    return random_gaussians(np.random.default_rng(4), 200)


def assert_kept(left: Gaussians, gaussians: Gaussians, kept: list[int]) -> None:
    assert 0 < len(kept) < len(gaussians)
    for field in fields(gaussians):
        before, after = getattr(gaussians, field.name), getattr(left, field.name)
        assert np.array_equal(after, before[kept] if isinstance(before, np.ndarray) else before)


def test_a_box_keeps_the_centres_inside_of_it_whichever_corners_are_given(cloud: Gaussians) -> None:
    kept = [
        i for i, (x, y, z) in enumerate(cloud.means) if -0.5 <= x <= 0.4 and -0.3 <= y <= 0.6 and -0.2 <= z <= 0.7
    ]
    assert_kept(edit.crop_box(cloud, (-0.5, -0.3, -0.2), (0.4, 0.6, 0.7)), cloud, kept)
    assert_kept(edit.crop_box(cloud, (0.4, -0.3, 0.7), (-0.5, 0.6, -0.2)), cloud, kept)


def test_a_sphere_keeps_the_centres_inside_of_it(cloud: Gaussians) -> None:
    kept = [i for i, mean in enumerate(cloud.means) if math.dist(mean, (0.1, 0.2, -0.3)) <= 0.6]
    assert_kept(edit.crop_sphere(cloud, (0.1, 0.2, -0.3), 0.6), cloud, kept)


def test_what_lies_on_the_surface_is_inside(cloud: Gaussians) -> None:
    corners = cloud.take(range(2))
    corners = replace(corners, means=np.array([[1, 2, 3], [-1, -2, -3]], np.float32))
    assert len(edit.crop_box(corners, (-1, -2, -3), (1, 2, 3))) == 2
    assert len(edit.crop_sphere(corners, (1, 2, 0), 3.0)) == 1
    assert len(edit.crop_sphere(corners, (1, 2, 3), 0.0)) == 1


def test_faint_splats_are_dropped(cloud: Gaussians) -> None:
    kept = [i for i, opacity in enumerate(cloud.opacities) if opacity >= 0.3]
    assert_kept(edit.drop_faint(cloud, 0.3), cloud, kept)
    assert len(edit.drop_faint(cloud, float(cloud.opacities.min()))) == 200


def test_splats_that_are_long_along_any_axis_are_dropped(cloud: Gaussians) -> None:
    kept = [i for i, scale in enumerate(cloud.scales) if max(scale) <= 0.1]
    assert_kept(edit.drop_large(cloud, 0.1), cloud, kept)
    assert len(edit.drop_large(cloud, float(cloud.scales.max()))) == 200


@pytest.mark.parametrize("limit", [0.1, 0.7, 0.9])
def test_a_limit_written_in_decimals_includes_its_own_float32(cloud: Gaussians, limit: float) -> None:
    exact = replace(cloud, opacities=np.full(200, limit), scales=np.full((200, 3), limit))
    assert len(edit.drop_faint(exact, limit)) == len(edit.drop_large(exact, limit)) == 200


def test_the_most_important_are_kept_in_their_order(cloud: Gaussians) -> None:
    best = np.argsort(-importance(cloud.scales, cloud.opacities))[:30]
    assert_kept(edit.keep_most_important(cloud, 30), cloud, sorted(best.tolist()))
    assert edit.keep_most_important(cloud, 200) is cloud


def test_a_sphere_of_a_negative_radius_is_refused(cloud: Gaussians) -> None:
    with pytest.raises(OptionError, match="radius"):
        edit.crop_sphere(cloud, (0, 0, 0), -1.0)


@pytest.mark.parametrize("keeps", [
    lambda scene: edit.crop_box(scene, (-1, -1, -1), (1, 1, 1)),
    lambda scene: edit.crop_sphere(scene, (0, 0, 0), 1),
    lambda scene: edit.drop_faint(scene, 0.5),
    lambda scene: edit.drop_large(scene, 0.5),
    lambda scene: edit.keep_most_important(scene, 9),
])  # fmt: skip
def test_nothing_of_nothing_is_nothing(cloud: Gaussians, keeps) -> None:  # type: ignore[no-untyped-def]
    assert len(keeps(cloud.take([]))) == 0
