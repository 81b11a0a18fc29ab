"""Decimating gives as many splats as asked for, each a proper one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.scenes import random_gaussians
from tsplat._jit import JIT
from tsplat.errors import OptionError
from tsplat.lod import decimate
from tsplat.lod.decimate import principal_axes
from tsplat.raster import reference
from tsplat.scene import Gaussians

N = 1500 if JIT else 40


@pytest.mark.parametrize("count", [1, 2, N // 7, N // 2, N - 1])
def test_as_many_splats_are_left_as_asked_for(count: int) -> None:
    scene = replace(random_gaussians(np.random.default_rng(0), N), antialiased=True)
    seen: list[float] = []
    found = decimate(scene, count, progress=seen.append)
    assert len(found) == count
    assert found.sh_degree == scene.sh_degree
    assert found.antialiased
    assert seen == sorted(seen)
    assert seen[-1] == 1.0


def test_a_scene_small_enough_stays_what_it_is() -> None:
    scene = random_gaussians(np.random.default_rng(0), 10)
    assert decimate(scene, 10) is scene


def test_none_at_all_cannot_be_kept() -> None:
    with pytest.raises(OptionError, match="count must be 1 or more, got 0"):
        decimate(random_gaussians(np.random.default_rng(0), 10), 0)


def test_principal_axes_make_the_covariance_they_are_of() -> None:
    scene = random_gaussians(np.random.default_rng(4), 500)
    upper = reference.covariances(scene.quats, scene.scales)[:, *np.triu_indices(3)].astype(np.float32)
    quats, scales = principal_axes(upper)
    np.testing.assert_allclose(np.linalg.norm(quats, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(reference.covariances(quats, scales)[:, *np.triu_indices(3)], upper, atol=1e-7)


def scaled(scene: Gaussians, places: float, sizes: float) -> Gaussians:
    means, scales = scene.means.astype(np.float64) * places, scene.scales.astype(np.float64) * sizes
    return replace(scene, means=means, scales=scales)


@pytest.mark.parametrize("places", [0.0, 1e-30, 1e-12, 1.0, 1e12, 1e30, 1e37])
@pytest.mark.parametrize("sizes", [0.0, 1e-30, 1e-12, 1.0, 1e12, 1e30, 1e37])
def test_scenes_of_any_size_are_merged(places: float, sizes: float) -> None:
    scene = scaled(random_gaussians(np.random.default_rng(1), N // 10), places, sizes)
    for count in (1, N // 25):
        found = decimate(scene, count)
        assert len(found) == count
        assert np.abs(found.means).max() <= 2 * np.abs(scene.means).max()


@pytest.mark.parametrize("exponent", [-100, -40, 40, 100])
def test_a_scene_is_merged_alike_in_all_units(exponent: int) -> None:
    scene = random_gaussians(np.random.default_rng(2), N // 10)
    unit = 2.0**exponent
    found, expected = decimate(scaled(scene, unit, unit), N // 30), decimate(scene, N // 30)
    np.testing.assert_allclose(found.means / unit, expected.means, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(found.scales / unit, expected.scales, rtol=1e-2, atol=1e-3)


@pytest.mark.parametrize("size", [1e20, 1e30, 3e38])
@pytest.mark.parametrize("giants", [1, 3, N // 8])
def test_splats_beyond_all_measure_are_set_apart(size: float, giants: int) -> None:
    scene = random_gaussians(np.random.default_rng(3), N // 2)
    scales, means = scene.scales.copy(), scene.means.copy()
    scales[:giants:2], means[1:giants:2] = size, -size
    few = decimate(scene.take(np.arange(giants, N // 2)), N // 10)
    found = decimate(replace(scene, scales=scales, means=means), N // 10)
    assert len(found) == N // 10
    beyond = np.maximum(np.abs(found.means), found.scales).max(axis=1) > 1e19
    assert 0 < np.count_nonzero(beyond) <= min(giants, N // 20)
    assert found.scales[~beyond].max() < 3.0 * few.scales.max()
