"""Levels of detail hold the scene, and each next one the same with half as many splats."""

from __future__ import annotations

import numpy as np
import pytest

from tests.lod import slow
from tests.raster.compare import front_camera, psnr
from tests.scenes import random_gaussians
from tsplat._jit import JIT, kernel
from tsplat.lod import Cut, decimate, hierarchy
from tsplat.lod.kd import kd_order
from tsplat.lod.levels import coarser, finest
from tsplat.lod.merge import merge
from tsplat.lod.merge_scratch import new_scratch, of_worker, take
from tsplat.raster import rasterize, rasterize_blocks, reference
from tsplat.raster.prepare import BLOCK
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians

N = 1300 if JIT else 60

_take, _merge = kernel(take), kernel(merge)


def level_of(gaussians: Gaussians, threads: int = 2):  # type: ignore[no-untyped-def]
    return finest(gaussians, kd_order(gaussians.means, threads), threads)


def mixture(level):  # type: ignore[no-untyped-def]
    """Return mass, mean, covariance and mean harmonics of all splats of a level together."""
    covars = slow.full(level.covars)
    masses = level.opacities.astype(np.float64) * [slow.area(covar) for covar in covars]
    sh = np.einsum("n,nkc->kc", masses, level.sh.astype(np.float64)) / masses.sum()
    return (*slow.moments(masses, level.means.astype(np.float64), covars), sh)


def test_the_finest_level_is_the_scene_in_the_order_asked_for() -> None:
    gaussians = random_gaussians(np.random.default_rng(0), N)
    order = kd_order(gaussians.means, 2)
    level = finest(gaussians, order, 2)
    for name in ("means", "opacities", "sh"):
        np.testing.assert_array_equal(getattr(level, name), getattr(gaussians, name)[order])
    expected = reference.covariances(gaussians.quats, gaussians.scales)[order]
    np.testing.assert_allclose(slow.full(level.covars), expected, atol=1e-7)


@pytest.mark.parametrize("n", [1, 2, 3, BLOCK + 1, 2 * BLOCK + 1, N])
def test_the_next_level_has_half_as_many_and_the_same_moments(n: int) -> None:
    rng = np.random.default_rng(n)
    gaussians = random_gaussians(rng, n, 1)
    gaussians = Gaussians(*gaussians.arrays[:3], 0.02 * gaussians.opacities + 0.01, gaussians.sh)
    level = level_of(gaussians)
    half = coarser(level, 2)
    assert len(half.means) == -(-n // 2)
    for before, after in zip(mixture(level), mixture(half), strict=True):
        np.testing.assert_allclose(after, before, rtol=2e-3, atol=2e-4)


def test_a_level_can_have_any_size_from_half_up() -> None:
    level = level_of(random_gaussians(np.random.default_rng(0), N, 0))
    for kept in (-(-N // 2), N // 2 + 7, N - 1, N):
        assert len(coarser(level, 2, kept).means) == kept


def test_levels_are_the_same_bits_whatever_the_number_of_threads() -> None:
    gaussians = random_gaussians(np.random.default_rng(5), N)
    for one, three in zip(coarser(level_of(gaussians), 1), coarser(level_of(gaussians), 3), strict=True):
        np.testing.assert_array_equal(one, three)


def odd_scenes() -> dict[str, Gaussians]:
    """Return scenes that no training makes, but that a file may hold."""
    means, quats, scales, opacities, sh = random_gaussians(np.random.default_rng(2), 3 * BLOCK, 0).arrays
    some = np.arange(len(means)) % 50 == 0
    return {
        "points": Gaussians(means, quats, 0 * scales, opacities, sh),
        "far points": Gaussians(1e6 * means, quats, 0 * scales, opacities, sh),
        "one place": Gaussians(0 * means, quats, 0 * scales, opacities, sh),
        "unseen": Gaussians(means, quats, scales, 0 * opacities, sh),
        "giants": Gaussians(means, quats, np.where(some[:, None], 1e12, 1e-6) * scales, opacities, sh),
        "unseen giants": Gaussians(
            means, quats, np.where(some[:, None], 1e9, 1e-6) * scales, np.where(some, 0, opacities), sh
        ),
        "needles": Gaussians(means, quats, scales * np.array([1e4, 1e-9, 0]), opacities, sh),
        "worlds": Gaussians(1e18 * means, quats, 1e15 * scales, opacities, sh),
        "specks": Gaussians(1e-12 * means, quats, 1e-14 * scales, opacities, sh),
        "glaring": Gaussians(means, quats, scales, opacities, 1e20 * sh),
    }


@pytest.mark.skipif(not JIT, reason="thousands of splats take minutes without a compiler")
@pytest.mark.parametrize("name", odd_scenes())
def test_odd_scenes_are_merged_as_well_as_can_be(name: str) -> None:
    scene = odd_scenes()[name]
    for count in (2 * BLOCK, 100, 1):
        merged = decimate(scene, count)  # a scene checks that it is one
        assert len(merged) == count
        assert (merged.means.min(0) >= scene.means.min(0) - 1e-3 * abs(scene.means).max()).all()
        assert (merged.means.max(0) <= scene.means.max(0) + 1e-3 * abs(scene.means).max()).all()
    camera = front_camera(32, 24)
    blocks = Cut(hierarchy(scene, 2)).blocks(camera, RenderOptions(), BLOCK)
    rendering = rasterize_blocks(hierarchy(scene, 2).scene, blocks, camera, RenderOptions())
    assert np.isfinite(rendering.alphas).all()


def scratch_of(gaussians: Gaussians):  # type: ignore[no-untyped-def]
    scratch = of_worker(new_scratch(1, 3 * gaussians.sh.shape[1]), 0)
    level = finest(gaussians, np.arange(len(gaussians), dtype=np.int32), 1)
    _take(level, 0, len(gaussians), scratch)
    return scratch


def splat_of(scratch, i: int):  # type: ignore[no-untyped-def]
    return {
        "mass": float(scratch.masses[i]),
        "mean": np.array([scratch.x[i], scratch.y[i], scratch.z[i]], np.float64),
        "covar": slow.full(scratch.covars[i]),
        "color": scratch.sh[i, :3].astype(np.float64),
    }


def test_a_pair_costs_what_the_slow_formula_says() -> None:
    for seed in range(8):
        scratch = scratch_of(random_gaussians(np.random.default_rng(seed), 2, 0))
        _merge(scratch, 2)
        expected = slow.cost(splat_of(scratch, 0), splat_of(scratch, 1))
        found = scratch.costs[:2]
        np.testing.assert_allclose(found, expected, rtol=2e-3, atol=2e-5 * scratch.masses[:2].max() ** 2)
        np.testing.assert_array_equal(scratch.partners[:2], [1, 0])


def test_the_cheapest_of_eight_neighbours_is_the_partner() -> None:
    scratch = scratch_of(random_gaussians(np.random.default_rng(3), 9, 0))
    _merge(scratch, 9)
    for i in range(9):
        costs = [np.inf if j == i else slow.cost(splat_of(scratch, i), splat_of(scratch, j)) for j in range(9)]
        if i in (0, 8):  # these two share a lane for all the others, so the farther may go unseen
            continue
        seen = [j for j in range(9) if j not in (0, 8)]
        assert scratch.costs[i] <= min(costs[j] for j in seen) * 1.01 + 1e-6


def test_a_merged_scene_looks_more_like_it_than_as_many_of_its_splats() -> None:
    gaussians = random_gaussians(np.random.default_rng(9), 2000 if JIT else 40, 0)
    gaussians = Gaussians(gaussians.means, gaussians.quats, 0.3 * gaussians.scales, *gaussians.arrays[3:])
    camera, options = front_camera(48, 36), RenderOptions(antialias="mip", depths=False)
    truth = rasterize(gaussians, camera, options).colors
    merged = rasterize(decimate(gaussians, len(gaussians) // 4), camera, options).colors
    skipped = rasterize(gaussians.take(range(0, len(gaussians), 4)), camera, options).colors
    assert psnr(merged, truth) > psnr(skipped, truth) + 3.0
