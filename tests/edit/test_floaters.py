"""What counts as a floater."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.scenes import random_gaussians
from tests.test_neighbours import by_all_pairs
from tsplat.edit import join, remove_floaters
from tsplat.edit.floaters import NEIGHBOURS
from tsplat.scene import Gaussians


@pytest.fixture
def cloud() -> Gaussians:
    """A cloud of 400 with 5 splats far around it, the last ones."""
    rng = np.random.default_rng(1)
    gaussians = random_gaussians(rng, 405)
    means = gaussians.means.copy()
    means[400:] = rng.normal(size=(5, 3)) * 20
    return replace(gaussians, means=means)


def test_what_floats_far_from_the_rest_goes_and_the_rest_stays_in_order(cloud: Gaussians) -> None:
    left = remove_floaters(cloud)
    assert np.array_equal(left.means, cloud.means[:400])
    assert np.array_equal(left.sh, cloud.sh[:400])


@pytest.mark.parametrize("sigmas", [0.0, 0.5, 1.0, 3.0])
def test_what_goes_is_what_is_so_many_deviations_above_the_mean(cloud: Gaussians, sigmas: float) -> None:
    alone = np.log1p(by_all_pairs(cloud.means, cloud.scales.max(axis=1), NEIGHBOURS))
    kept = alone <= alone.mean() + sigmas * alone.std()
    assert np.array_equal(remove_floaters(cloud, sigmas).means, cloud.means[kept])
    assert 0 < kept.sum() < 405


def test_large_splats_far_from_each_other_are_a_surface_and_small_ones_are_not(cloud: Gaussians) -> None:
    near, grid = cloud.take(range(400)), np.array([(x, y, 30) for x in range(5) for y in range(4)])
    wall = replace(cloud.take(range(20)), means=grid, scales=np.full((20, 3), 1.0))
    assert np.array_equal(remove_floaters(join([near, wall])).means[-20:], grid)
    dust = replace(wall, scales=np.full((20, 3), 0.001))
    assert np.array_equal(remove_floaters(join([near, dust])).means, near.means)


@pytest.mark.parametrize("n", [0, 1, 2])
def test_a_scene_of_hardly_anything_has_no_floaters(n: int) -> None:
    assert len(remove_floaters(random_gaussians(np.random.default_rng(0), n))) == n
