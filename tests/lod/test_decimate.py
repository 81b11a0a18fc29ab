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
