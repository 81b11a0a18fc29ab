"""A budget of splats is kept, covers what is in view once, and is spent where it shows."""

from __future__ import annotations

import numpy as np
import pytest

import tsplat
from tests.raster.compare import front_camera, psnr
from tests.scenes import random_gaussians
from tsplat._jit import JIT
from tsplat.camera import Camera
from tsplat.errors import OptionError
from tsplat.lod import Cut, hierarchy
from tsplat.lod.hierarchy import Hierarchy, level_firsts
from tsplat.raster import rasterize, rasterize_blocks
from tsplat.raster.prepare import BLOCK
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians

pytestmark = pytest.mark.skipif(not JIT, reason="thousands of splats take minutes without a compiler")

N = 20 * BLOCK - 5
CAMERA = front_camera(64, 48)
OPTIONS = RenderOptions(antialias="mip", depths=False)


@pytest.fixture(scope="module")
def scene() -> Gaussians:
    cloud = random_gaussians(np.random.default_rng(0), N, 1)
    return Gaussians(cloud.means, cloud.quats, 0.2 * cloud.scales, *cloud.arrays[3:])


@pytest.fixture(scope="module")
def tree(scene: Gaussians) -> Hierarchy:
    return hierarchy(scene, 2)


def finest_under(block: int) -> list[int]:
    """Return the blocks of the finest level that a block stands for."""
    firsts = level_firsts(N)
    level = int(np.searchsorted(firsts, block, side="right")) - 1
    if level == 0:
        return [block]
    first = int(firsts[level - 1]) + 2 * (block - int(firsts[level]))
    last = min(first + 2, int(firsts[level]))
    return [leaf for child in range(first, last) for leaf in finest_under(child)]


@pytest.mark.parametrize(("splats", "counts"), [(1, [1]), (BLOCK, [1]), (5 * BLOCK - 1, [5, 3, 2, 1])])
def test_each_level_has_half_as_many_blocks(splats: int, counts: list[int]) -> None:
    np.testing.assert_array_equal(level_firsts(splats), np.cumsum([0, *counts]))


def test_bounds_hold_all_that_a_block_stands_for(tree: Hierarchy) -> None:
    bounds = tree.scene.bounds.reshape(-1, 5)
    means = tree.scene.means.reshape(3, -1, BLOCK)
    opaque = tree.scene.log2_opacities.reshape(-1, BLOCK) > -200
    for block in range(int(level_firsts(N)[-1])):
        for leaf in [block, *finest_under(block)]:
            apart = np.linalg.norm(means[:, leaf, opaque[leaf]].T - bounds[block, :3], axis=1)
            assert apart.max() <= bounds[block, 3] * (1 + 1e-5) + 1e-6
            assert bounds[leaf, 4] <= bounds[block, 4]


@pytest.mark.parametrize("budget", [1, BLOCK, 3 * BLOCK, 7 * BLOCK + 1, N])
def test_a_cut_keeps_the_budget_and_stands_for_every_splat_once(tree: Hierarchy, budget: int) -> None:
    blocks = Cut(tree).blocks(CAMERA, OPTIONS, budget)
    assert rasterize_blocks(tree.scene, blocks, CAMERA, OPTIONS).visible <= max(BLOCK, 1.1 * budget)
    leaves = [leaf for block in blocks.tolist() for leaf in finest_under(block)]
    assert sorted(leaves) == tree.finest.tolist()


def test_what_is_out_of_sight_gets_nothing(tree: Hierarchy) -> None:
    away = Camera.look_at((0, 0, -4), (0, 0, -8), (0, -1, 0), width=64, height=48, fov_y=40.0)
    assert not len(Cut(tree).blocks(away, OPTIONS, N))
    empty = rasterize_blocks(tree.scene, Cut(tree).blocks(away, OPTIONS, N), away, OPTIONS)
    assert empty.visible == 0
    assert not empty.colors.any()


def test_a_near_corner_is_finer_than_a_far_one(tree: Hierarchy) -> None:
    near = Camera.look_at((-0.9, 0, -0.9), (0.5, 0, 0.5), (0, -1, 0), width=64, height=48, fov_y=60.0)
    blocks = Cut(tree).blocks(near, OPTIONS, 6 * BLOCK)
    sizes = np.array([len(finest_under(block)) for block in blocks.tolist()])
    centers = tree.scene.bounds.reshape(-1, 5)[blocks, :3]
    distances = np.linalg.norm(centers - near.eye, axis=1)
    assert distances[sizes == sizes.min()].mean() < distances[sizes == sizes.max()].mean()


def test_a_whole_budget_draws_what_a_full_render_draws(scene: Gaussians, tree: Hierarchy) -> None:
    blocks = Cut(tree).blocks(CAMERA, OPTIONS, 2 * N)
    found, whole = rasterize_blocks(tree.scene, blocks, CAMERA, OPTIONS), rasterize(scene, CAMERA, OPTIONS)
    # Equal depths keep another order.
    assert psnr(found.colors, whole.colors) > 50.0
    assert found.visible == whole.visible


def test_more_budget_looks_more_like_the_scene(scene: Gaussians) -> None:
    whole = rasterize(scene, CAMERA, OPTIONS).colors
    close = [
        psnr(tsplat.render(scene, CAMERA, lod=n, antialias="mip").colors, whole)
        for n in (BLOCK, 4 * BLOCK, 16 * BLOCK)
    ]
    assert close == sorted(close)
    assert close[-1] > 35.0


def test_a_still_camera_gets_the_same_blocks_again(tree: Hierarchy) -> None:
    cut = Cut(tree)
    first = cut.blocks(CAMERA, OPTIONS, 5 * BLOCK)
    np.testing.assert_array_equal(cut.blocks(CAMERA, OPTIONS, 5 * BLOCK), first)


def test_a_scene_within_the_budget_is_drawn_to_the_bit(scene: Gaussians) -> None:
    np.testing.assert_array_equal(tsplat.render(scene, CAMERA, lod=N).colors, tsplat.render(scene, CAMERA).colors)
    np.testing.assert_array_equal(
        tsplat.render(scene, CAMERA, lod=True).colors, tsplat.render(scene, CAMERA).colors
    )


@pytest.mark.parametrize("lod", [0, -3])
def test_no_budget_at_all_is_refused(scene: Gaussians, lod: int) -> None:
    with pytest.raises(OptionError, match="lod must be 1 or more, got"):
        tsplat.render(scene, CAMERA, lod=lod)
