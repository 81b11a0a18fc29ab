"""The slow renderer against closed forms and photographs: it is what all else is measured by."""

from __future__ import annotations

import math

import numpy as np
import pytest
from PIL import Image

from tests.raster.compare import psnr
from tests.scenes import shared_scenes
from tsplat._jit import JIT
from tsplat.camera import Camera
from tsplat.io import load, load_cameras
from tsplat.raster import rasterize, reference
from tsplat.rendering import ALPHA_MAX, EPS2D, RenderOptions
from tsplat.scene import Gaussians


def ball(*, means: object = ((0, 0, 0),), sigma: float = 0.1, opacity: float = 0.8, red: float = 1.0) -> Gaussians:
    """Return round splats of one colour: red as given, no green, no blue."""
    n = len(means)  # type: ignore[arg-type]
    sh = np.full((n, 1, 3), -0.5 / 0.28209479177387814)
    sh[:, 0, 0] = (red - 0.5) / 0.28209479177387814
    return Gaussians(means, np.tile([1.0, 0, 0, 0], (n, 1)), np.full((n, 3), sigma), np.full(n, opacity), sh)  # type: ignore[arg-type]


def straight_on(width: int = 33, height: int = 33) -> Camera:
    """Return a camera at z = -5 that looks at the origin with a focal length of 100 pixels."""
    viewmat = np.eye(4)
    viewmat[2, 3] = 5.0
    return Camera(viewmat, np.array([[100.0, 0, width / 2], [0, 100.0, height / 2], [0, 0, 1]]), width, height)


def test_a_round_splat_straight_ahead_is_the_gaussian_of_its_projection() -> None:
    image = reference.rasterize(ball(), straight_on(), RenderOptions())
    variance = (100.0 * 0.1 / 5.0) ** 2 + EPS2D
    y, x = np.mgrid[0:33, 0:33] - 16.0
    expected = 0.8 * np.exp(-0.5 * (x * x + y * y) / variance)
    expected[expected < 1 / 255] = 0.0
    np.testing.assert_allclose(image.alphas, expected, atol=1e-6)
    np.testing.assert_allclose(image.colors[..., 0], expected, atol=1e-6)
    assert not image.colors[..., 1:].any()


def test_the_nearer_splat_hides_the_farther_by_its_alpha() -> None:
    scene = ball(means=((0, 0, 1.0), (0, 0, -1.0)), opacity=0.5)
    image = reference.rasterize(scene, straight_on(), RenderOptions(background=(0, 1, 0)))
    assert image.depths is not None
    np.testing.assert_allclose(image.alphas[16, 16], 0.75, atol=1e-6)
    np.testing.assert_allclose(image.depths[16, 16], (0.5 * 4.0 + 0.25 * 6.0) / 0.75, atol=1e-5)
    np.testing.assert_allclose(image.colors[16, 16], [0.75, 0.25, 0.0], atol=1e-6)


def test_alpha_is_capped_so_that_light_is_left() -> None:
    image = reference.rasterize(ball(opacity=1.0), straight_on(), RenderOptions())
    np.testing.assert_allclose(image.alphas.max(), ALPHA_MAX, atol=1e-6)


def test_right_in_the_world_is_right_in_the_image_and_down_is_down() -> None:
    right = reference.rasterize(ball(means=((0.4, 0, 0),)), straight_on(), RenderOptions()).alphas
    below = reference.rasterize(ball(means=((0, 0.4, 0),)), straight_on(), RenderOptions()).alphas
    assert np.unravel_index(right.argmax(), right.shape) == (16, 24)
    assert np.unravel_index(below.argmax(), below.shape) == (24, 16)


def test_relative_at_the_training_size_is_classic() -> None:
    classic, relative = (
        reference.rasterize(ball(), straight_on(), RenderOptions(antialias=mode, train_focal=100.0))
        for mode in ("classic", "relative")  # type: ignore[arg-type]
    )
    np.testing.assert_array_equal(classic.colors, relative.colors)


def test_relative_conserves_what_a_distant_splat_covers() -> None:
    near = reference.rasterize(
        ball(sigma=0.05), straight_on(), RenderOptions(antialias="relative", train_focal=800.0)
    )
    variance = (100.0 * 0.05 / 5.0) ** 2
    dilation = 0.3 / 64
    undilated = 0.8 * 2 * math.pi * (variance + dilation)
    np.testing.assert_allclose(near.alphas.sum(), undilated, rtol=0.03)


def test_softening_blurs_by_its_variance_and_keeps_all_light() -> None:
    point = np.zeros((9, 11, 3), np.float32)
    point[4, 5] = 1.0
    soft = reference.soften(point, 0.2)
    np.testing.assert_allclose(soft.sum(axis=(0, 1)), 1.0, atol=1e-6)
    y, x = np.mgrid[-4:5, -5:6]
    for squared in (x * x, y * y):
        np.testing.assert_allclose((soft[..., 0] * squared).sum(), 0.2, atol=1e-6)
    np.testing.assert_allclose(reference.soften(np.full((3, 2), 0.7, np.float32), 0.2), 0.7, atol=1e-6)


def test_the_basis_is_orthonormal_over_the_sphere() -> None:
    directions = np.random.default_rng(0).normal(size=(400_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    basis = reference.sh_basis(directions)
    np.testing.assert_allclose(basis.T @ basis * (4 * math.pi / len(basis)), np.eye(25), atol=0.04)


SNOWMIKU = shared_scenes() and shared_scenes() / "snowmiku"  # type: ignore[operator]


@pytest.mark.skipif(not JIT, reason="tens of thousands of splats take hours without a compiler")
@pytest.mark.skipif(SNOWMIKU is None, reason="the folder of real scenes is not there; set TSPLAT_SCENES to it")
def test_held_out_photographs_are_seen_the_right_way_round() -> None:
    assert SNOWMIKU is not None
    scene = load(SNOWMIKU / "trained" / "snow_sh3_3000.ply")
    for view in load_cameras(SNOWMIKU / "cameras.json")[::24]:
        photograph = np.asarray(Image.open(next(SNOWMIKU.glob(f"images_16/{view.name}*"))).convert("RGB")) / 255
        height, width = photograph.shape[:2]
        image = rasterize(scene, view.camera.resized(width, height), RenderOptions(depths=False)).colors
        assert psnr(image, photograph) > 23.0
        assert psnr(image[:, ::-1], photograph) < 18.0


@pytest.mark.skipif(not JIT, reason="tens of thousands of splats take hours without a compiler")
@pytest.mark.skipif(SNOWMIKU is None, reason="the folder of real scenes is not there; set TSPLAT_SCENES to it")
@pytest.mark.parametrize(("divisor", "floor"), [(8, 28.9), (4, 30.0), (2, 30.3), (1, 29.6)])
def test_relative_is_what_photographs_of_every_size_show(divisor: int, floor: float) -> None:
    assert SNOWMIKU is not None
    scene = load(SNOWMIKU / "trained" / "snow_sh3_3000.ply")
    width, height = 248 // divisor, 186 // divisor
    found = []
    for view in load_cameras(SNOWMIKU / "cameras.json")[::8]:
        with Image.open(SNOWMIKU / "images_16" / f"{view.name}.png") as whole:
            photograph = np.asarray(whole.convert("RGB"), np.float64)[: height * divisor, : width * divisor] / 255
        K = view.camera.resized(248, 186).K.copy()
        K[:2] /= divisor
        camera = Camera(view.camera.viewmat, K, width, height)
        options = RenderOptions(antialias="relative", train_focal=205.3, depths=False)
        small = photograph.reshape(height, divisor, width, divisor, 3).mean(axis=(1, 3))
        found.append(psnr(np.clip(rasterize(scene, camera, options).colors, 0.0, 1.0), small))
    assert len(found) == 13
    assert np.mean(found) > floor
