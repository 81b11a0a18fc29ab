"""How near the training cameras came, and what that does to splats that the eye comes nearer to still."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from tests.raster.compare import assert_like_reference, front_camera
from tests.scenes import random_gaussians
from tsplat._jit import JIT
from tsplat.camera import Camera
from tsplat.lod import Cut, hierarchy
from tsplat.raster import rasterize, rasterize_blocks, reference
from tsplat.raster.draw import draw
from tsplat.raster.prepare import BLOCK, prepared
from tsplat.raster.train_depths import UNSEEN, deepest
from tsplat.rendering import EPS2D, RenderOptions
from tsplat.scene import Gaussians
from tsplat.train_views import MOST, NEAREST, REACH, TrainViews

MANY = 700 if JIT else 60


def views_of(*cameras: Camera) -> TrainViews:
    views = TrainViews.of(cameras)
    assert views is not None
    return views


def random_camera(rng: np.random.Generator) -> Camera:
    """Return a camera around `random_gaussians`, or within, that has some of them in view."""
    eye = rng.normal(0, 1, 3)
    eye *= rng.uniform(0.2, 5) / np.linalg.norm(eye)
    fov = float(rng.uniform(20, 90))
    return Camera.look_at(eye, rng.normal(0, 0.3, 3), (0, -1, 0), width=64, height=40, fov_y=fov)


def at_distance(distance: float, side: int = 33, fov_y: float = 40.0, sideways: float = 0.0) -> Camera:
    """Return a camera that looks along +z past the origin."""
    eye, target = (sideways, 0.0, -distance), (sideways, 0.0, 0.0)
    return Camera.look_at(eye, target, (0, -1, 0), width=side, height=side, fov_y=fov_y)


def ball(sigma: float = 0.01, mean: tuple[float, float, float] = (0, 0, 0), opacity: float = 0.9) -> Gaussians:
    """Return one round splat."""
    arrays: Any = [mean], [(1, 0, 0, 0)], [(sigma,) * 3], [opacity], np.full((1, 1, 3), 1.5)
    return Gaussians(*arrays)


def relative(train_focal: float = 100.0, **fields: Any) -> RenderOptions:
    return RenderOptions(antialias="relative", train_focal=train_focal, **fields)


def depths_of(gaussians: Gaussians, views: TrainViews) -> npt.NDArray[np.float32]:
    """Return what the kernel finds, having drawn all splats."""
    afar = front_camera(8, 6)
    rasterize(gaussians, afar, relative(train_views=views))
    kept = prepared(gaussians, 1).train_depths
    assert kept is not None
    return kept.depths[: len(gaussians)]


def test_a_point_is_in_view_where_its_pixel_is_in_the_picture_or_near_it() -> None:
    K = [[90.0, 0, 11.0], [0, 60.0, 40.5], [0, 0, 1]]
    camera = Camera(random_camera(np.random.default_rng(0)).viewmat, np.array(K), 64, 48)
    points = np.random.default_rng(1).normal(0, 2, (4000, 3))
    means2d, depths, _ = reference.project(points, np.zeros((4000, 3, 3)), camera)
    beside = np.abs(means2d - (32, 24)) < REACH * np.array([32, 24])
    expected = beside.all(axis=1) & (depths > NEAREST)
    found = reference.train_depths(points, views_of(camera))
    assert 100 < expected.sum() < 3900
    np.testing.assert_array_equal(found > 0, expected)
    np.testing.assert_allclose(found[expected], depths[expected], rtol=1e-5)


def test_of_many_cameras_the_first_the_last_and_some_between_are_taken() -> None:
    assert TrainViews.of([]) is None
    cameras = [at_distance(1.0 + number) for number in range(4 * MOST)]
    depths = views_of(*cameras).frusta[:, 2, 3]
    assert len(depths) == MOST
    assert (depths[0], depths[-1]) == pytest.approx((1, 4 * MOST))
    assert set(np.diff(depths.round())) <= {4, 5}
    assert len(views_of(*cameras[:7]).frusta) == 7


@pytest.mark.parametrize("count", [1, 2, 9])
def test_depths_are_those_of_the_reference(count: int) -> None:
    rng = np.random.default_rng(count)
    gaussians, views = random_gaussians(rng, 400), views_of(*(random_camera(rng) for _ in range(count)))
    expected = reference.train_depths(gaussians.means, views)
    np.testing.assert_allclose(depths_of(gaussians, views), expected, rtol=1e-5)
    assert (expected > 0).any()
    assert (expected == UNSEEN).any() or count > 1


def test_depths_are_those_of_the_cameras_of_the_last_frame() -> None:
    gaussians = ball()
    for distance in (3.0, 5.0, 3.0):
        assert depths_of(gaussians, views_of(at_distance(distance)))[0] == pytest.approx(distance)


@pytest.mark.parametrize("seed", range(4))
def test_no_splat_is_deeper_than_its_bounds_say_and_of_small_ones_hardly_less(seed: int) -> None:
    rng = np.random.default_rng(seed)
    blocks = 6
    places = np.repeat(rng.normal(0, 1.5, (blocks, 3)), BLOCK, axis=0)
    sizes = np.repeat([1e-3, 1e-3, 1e-3, 0.1, 0.5, 1.0], BLOCK)[:, None]
    many = random_gaussians(rng, blocks * BLOCK, 0)
    gaussians = replace(many, means=(many.means * sizes + places).astype(np.float32))
    views = views_of(*(random_camera(rng) for _ in range(5)))
    most = deepest(prepared(gaussians, 1).bounds, views)
    found = reference.train_depths(gaussians.means, views).reshape(blocks, BLOCK).max(axis=1)
    assert (found <= most).all()
    assert (most[:3] < 1.01 * np.maximum(found[:3], 0.0) + 0.01).all()


@pytest.mark.parametrize("train_focal", [40.0, 90.0])
def test_it_matches_the_reference_nearer_than_any_camera(train_focal: float) -> None:
    rng = np.random.default_rng(11)
    gaussians = random_gaussians(rng, MANY)
    cameras = [front_camera(), at_distance(2.0), at_distance(3.0, sideways=2.0)]
    options = relative(train_focal, train_views=views_of(*cameras), background=(0.2, 0.5, 0.9))
    near = Camera.look_at((0.1, 0.1, -1.0), (0, 0, 0), (0, -1, 0), width=64, height=48, fov_y=60.0)
    ours = assert_like_reference(gaussians, near, options)
    without = rasterize(gaussians, near, replace(options, train_views=None))
    assert np.abs(ours.colors - without.colors).max() > 0.05
    other = rasterize(gaussians, near, replace(options, threads=3))
    np.testing.assert_array_equal(ours.colors, other.colors)


@pytest.mark.parametrize("antialias", ["classic", "mip"])
def test_other_modes_know_of_no_cameras(antialias: Any) -> None:
    gaussians, views = random_gaussians(np.random.default_rng(5), MANY), views_of(front_camera())
    options = RenderOptions(antialias=antialias, train_views=views)
    near = at_distance(1.0)
    expected = rasterize(gaussians, near, replace(options, train_views=None))
    np.testing.assert_array_equal(rasterize(gaussians, near, options).colors, expected.colors)
    assert prepared(gaussians, 1).train_depths is None


def test_nothing_changes_from_where_a_camera_was_and_behind_it() -> None:
    gaussians, camera = random_gaussians(np.random.default_rng(6), MANY), front_camera()
    options = relative(train_views=views_of(camera))
    there, there_before = (rasterize(gaussians, camera, each) for each in (options, relative()))
    np.testing.assert_allclose(there.colors, there_before.colors, atol=2e-5)
    viewmat = camera.viewmat.copy()
    viewmat[2, 3] += 0.5
    behind = Camera(viewmat, camera.K, camera.width, camera.height)
    back, back_before = (rasterize(gaussians, behind, each) for each in (options, relative()))
    np.testing.assert_array_equal(back.colors, back_before.colors)
    assert back.visible > MANY // 2


def test_a_splat_that_no_camera_saw_is_left_alone() -> None:
    gaussians, near = random_gaussians(np.random.default_rng(7), MANY), at_distance(1.0)
    away = Camera.look_at((0, 0, -4), (0, 0, -9), (0, -1, 0), width=64, height=48, fov_y=40.0)
    expected = rasterize(gaussians, near, relative())
    found = rasterize(gaussians, near, relative(train_views=views_of(away)))
    np.testing.assert_array_equal(found.colors, expected.colors)


@pytest.mark.parametrize("distance", [3.0, 1.0, 0.25])
@pytest.mark.parametrize("train_focal", [30.0, 300.0])
def test_nearer_than_every_camera_the_blur_keeps_its_size_in_the_world(
    distance: float, train_focal: float
) -> None:
    far, eye = 4.0, at_distance(distance)
    found = rasterize(ball(), eye, relative(train_focal, train_views=views_of(at_distance(far))))
    sigma = math.sqrt(0.01**2 + EPS2D * (far / train_focal) ** 2)
    baked = rasterize(ball(sigma), eye, relative(train_focal, eps2d=0.0))
    np.testing.assert_allclose(found.alphas, baked.alphas, atol=2e-3)
    without = rasterize(ball(), eye, relative(train_focal))
    assert np.abs(found.alphas - without.alphas).max() > 0.02


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_splat_beside_the_picture_is_drawn_where_its_blur_reaches_into_it(axis: int, side: float) -> None:
    eye = at_distance(0.5, fov_y=60.0)
    mean = [0.0, 0.0, 0.0]
    mean[axis] = side * (0.5 * math.tan(math.radians(30)) + 0.1)
    beside = ball(0.001, tuple(mean))  # type: ignore[arg-type]
    options = relative(40.0, train_views=views_of(at_distance(4.0)))
    image = assert_like_reference(beside, eye, options)
    assert image.alphas.max() > 0.1
    assert rasterize(beside, eye, relative(40.0)).visible == 0
    assert len(Cut(hierarchy(beside, 1)).blocks(eye, options, BLOCK)) == 1
    assert not len(Cut(hierarchy(beside, 1)).blocks(eye, relative(40.0), BLOCK))


@pytest.mark.parametrize("far", [1e2, 1e5, 1e9])
@pytest.mark.parametrize("train_focal", [10.0, 1000.0])
def test_right_before_the_eye_every_pixel_stays_a_number(far: float, train_focal: float) -> None:
    options = relative(train_focal, train_views=views_of(at_distance(far)), background=(0.2, 0.5, 0.9), threads=1)
    with np.errstate(all="ignore"):  # of kernels as plain Python
        image = rasterize(ball(), at_distance(0.0101), options)
    assert np.isfinite(image.colors).all()
    assert ((image.alphas >= 0) & (image.alphas <= 1)).all()


@pytest.mark.skipif(not JIT, reason="nothing is compiled")
def test_no_kernel_is_compiled_again_where_cameras_are_known() -> None:
    gaussians = ball()
    rasterize(gaussians, at_distance(2.0), relative())
    types = set(draw.codes)
    rasterize(gaussians, at_distance(2.0), relative(train_views=views_of(at_distance(3.0))))
    assert set(draw.codes) == types


@pytest.mark.skipif(not JIT, reason="thousands of splats take minutes without a compiler")
def test_the_finest_level_is_drawn_to_the_bit_as_the_scene_in_its_order() -> None:
    rng = np.random.default_rng(9)
    gaussians, near = random_gaussians(rng, 9 * BLOCK - 7, 1), at_distance(1.2)
    options = relative(30.0, train_views=views_of(*(random_camera(rng) for _ in range(3)), front_camera()))
    tree = hierarchy(gaussians, 2)
    ours = rasterize_blocks(tree.scene, tree.finest, near, options)
    order = np.lexsort(gaussians.means.T)
    sought = np.lexsort(tree.scene.means.reshape(3, -1)[:, : len(gaussians)])
    source = np.empty(len(gaussians), np.intp)
    source[sought] = order
    theirs = rasterize(gaussians.take(source), near, options)
    np.testing.assert_array_equal(ours.colors, theirs.colors)
    apart = ours.colors - rasterize_blocks(tree.scene, tree.finest, near, relative(30.0)).colors
    assert np.abs(apart).max() > 0.05
