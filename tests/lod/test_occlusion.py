"""Blocks take light from those behind them, as a slow twin says, and what gets none is not taken apart."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pytest

from tests.lod import slow
from tests.raster.compare import front_camera
from tests.scenes import random_gaussians
from tsplat._jit import JIT, kernel
from tsplat.camera import Camera
from tsplat.lod import Cut, Hierarchy, hierarchy
from tsplat.lod.occlusion import CELLS, fill_light
from tsplat.raster.frame import camera_numbers
from tsplat.raster.prepare import BLOCK
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians

F32 = npt.NDArray[np.float32]

CAMERA = front_camera(60, 40)
OPTIONS = RenderOptions(depths=False)

_fill_light = kernel(fill_light)


class Job(NamedTuple):
    """What `fill_light` looks at and fills."""

    bounds: F32
    solidities: F32
    numbers: F32
    queue: npt.NDArray[np.uint64]
    light: F32
    remaining: F32


def light_of(balls: npt.ArrayLike, solidities: npt.ArrayLike, camera: Camera = CAMERA) -> F32:
    """Return the light of blocks with these middles and radii."""
    balls = np.asarray(balls, np.float32)
    count = len(balls)
    job = Job(
        np.column_stack([balls, np.zeros(count, np.float32)]).ravel(), np.asarray(solidities, np.float32),
        camera_numbers(camera, OPTIONS), np.zeros(count + 2, np.uint64), np.full(count, -1, np.float32),
        np.zeros(CELLS * CELLS, np.float32),
    )  # fmt: skip
    _fill_light(np.arange(count, dtype=np.int32), count, job)
    return job.light


def towards(camera: Camera, distance: float) -> npt.NDArray[np.float64]:
    """Return what lies in the middle of the image, so far away."""
    return camera.eye + distance * camera.viewmat[2, :3]


@pytest.mark.parametrize("seed", range(20 if JIT else 2))
def test_the_light_of_blocks_is_what_a_slow_twin_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count = 40 if JIT else 12
    balls = np.column_stack([rng.normal(0.0, 1.5, (count, 3)), rng.uniform(0.01, 1.0, count)])
    camera = Camera.look_at(rng.normal(0, 2, 3), (0, 0, 0), (0, -1, 0), width=60, height=40, fov_y=60.0)
    solidities = rng.uniform(0.0, 1.0, count)
    expected = slow.light(balls, solidities, camera, CELLS)
    assert expected.min() < 0.9
    # In sight, bounds are a little wider than they are.
    np.testing.assert_allclose(light_of(balls, solidities, camera), expected, atol=0.01)


def test_a_solid_block_leaves_nothing_for_one_behind_it_and_all_for_one_beside_it() -> None:
    middle = towards(CAMERA, 4.0)
    beside = middle + 0.9 * CAMERA.viewmat[0, :3]
    light = light_of([[*towards(CAMERA, 3.0), 0.5], [*middle, 0.2], [*beside, 0.2]], [1.0, 0.5, 0.5])
    np.testing.assert_allclose(light, [1.0, 0.0, 1.0], atol=1e-6)


@pytest.mark.parametrize("distance", [0.0, 0.2, -3.0])
def test_what_is_around_the_eye_or_behind_it_hides_nothing(distance: float) -> None:
    light = light_of([[*towards(CAMERA, distance), 1.0], [*towards(CAMERA, 4.0), 0.5]], [1.0, 1.0])
    np.testing.assert_array_equal(light, [1.0, 1.0])


@pytest.mark.skipif(not JIT, reason="thousands of splats take minutes without a compiler")
def test_solidity_is_the_light_that_all_splats_of_a_block_take_from_a_face_of_its_cube() -> None:
    tree = hierarchy(random_gaussians(np.random.default_rng(0), 5 * BLOCK - 9, 1), 2)
    covars = slow.full(tree.scene.covars.reshape(6, -1, BLOCK).transpose(1, 2, 0))
    opacities = 2.0 ** tree.scene.log2_opacities.reshape(-1, BLOCK).astype(np.float64)
    for block, radius in enumerate(tree.scene.bounds.reshape(-1, 5)[:, 3]):
        areas = np.array([slow.area(covar) for covar in covars[block]])
        face = (2.0 * radius / np.sqrt(3.0)) ** 2
        expected = 1.0 - np.exp(-2.0 * np.pi * (opacities[block] @ areas) / face)
        np.testing.assert_allclose(tree.solidities[block], expected, rtol=1e-3)


@pytest.mark.skipif(not JIT, reason="thousands of splats take minutes without a compiler")
def test_a_wall_leaves_less_of_the_budget_to_what_it_hides_and_more_to_the_rest() -> None:
    rng = np.random.default_rng(0)
    n = 64 * BLOCK
    cloud = random_gaussians(rng, 3 * n, 0)
    means = rng.uniform(-1.0, 1.0, (3 * n, 3)).astype(np.float32) * np.float32(0.5)
    wall, hidden, beside = (slice(i * n, (i + 1) * n) for i in range(3))
    means[wall] = means[wall] * (1.2, 1.2, 0.01) - (0.6, 0.0, 1.0)
    means[hidden] -= (0.6, 0.0, 0.0)
    means[beside] += (0.6, 0.0, 0.0)
    tree = hierarchy(Gaussians(means, cloud.quats, 0.3 * cloud.scales, cloud.opacities, cloud.sh), 2)
    camera = Camera.look_at((0, 0, -5), (0, 0, 0), (0, -1, 0), width=64, height=48, fov_y=30.0)

    def blocks_behind(tree: Hierarchy) -> tuple[int, int]:
        middles = tree.scene.bounds.reshape(-1, 5)[Cut(tree).blocks(camera, OPTIONS, n), :3]
        left, behind = middles[:, 0] < 0.0, middles[:, 2] > -0.6
        return int((behind & left).sum()), int((behind & ~left).sum())

    clear = replace(tree, solidities=np.zeros_like(tree.solidities))
    (hidden_blocks, others), (all_seen, others_if_seen) = blocks_behind(tree), blocks_behind(clear)
    assert hidden_blocks < 0.75 * all_seen
    assert others > others_if_seen
