"""The fast renderer against the slow one, and the laws that any renderer obeys."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.raster.compare import assert_like_reference, front_camera
from tests.scenes import random_gaussians
from tsplat._jit import JIT
from tsplat.camera import Camera
from tsplat.raster import rasterize
from tsplat.rendering import ANTIALIAS, Antialias, RenderOptions
from tsplat.scene import Gaussians

MANY = 2000 if JIT else 60


@pytest.mark.parametrize("antialias", ANTIALIAS)
@pytest.mark.parametrize("sh_degree", [0, 1, 2, 3, 4])
def test_it_matches_the_reference_in_every_mode_and_degree(antialias: Antialias, sh_degree: int) -> None:
    gaussians = random_gaussians(np.random.default_rng(1), MANY, max(3, sh_degree))
    options = RenderOptions(
        antialias=antialias, sh_degree=sh_degree, train_focal=150.0, background=(0.2, 0.5, 0.9)
    )
    assert_like_reference(gaussians, front_camera(), options)


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (16, 16), (17, 15), (33, 7), (64, 48)])
@pytest.mark.parametrize("n", [0, 1, 50])
def test_it_matches_the_reference_at_every_size(n: int, size: tuple[int, int]) -> None:
    gaussians = random_gaussians(np.random.default_rng(n), n)
    assert_like_reference(gaussians, front_camera(*size), RenderOptions(background=(0.1, 0.2, 0.3)))


@pytest.mark.parametrize("size", [(1, 1), (1, 5), (2, 1), (3, 40), (33, 17), (64, 48)])
def test_it_matches_the_reference_where_small_images_are_softened(size: tuple[int, int]) -> None:
    options = RenderOptions(antialias="relative", train_focal=400.0, background=(0.2, 0.5, 0.9))
    gaussians = random_gaussians(np.random.default_rng(2), MANY)
    assert_like_reference(gaussians, front_camera(*size), options)
    one, two = (rasterize(gaussians, front_camera(*size), replace(options, threads=each)) for each in (1, 2))
    np.testing.assert_array_equal(one.colors, two.colors)
    np.testing.assert_array_equal(one.alphas, two.alphas)


@pytest.mark.parametrize("eye", [(0.05, 0.02, -0.1), (0.0, 0.0, 4.0), (30.0, 0.0, 0.0), (0.0, -3.0, 0.01)])
def test_it_matches_the_reference_from_inside_behind_afar_and_above(eye: tuple[float, float, float]) -> None:
    gaussians = random_gaussians(np.random.default_rng(3), MANY)
    camera = Camera.look_at(eye, (0.1, 0.05, 0.3), (0, -1, 0), width=48, height=33, fov_y=70.0)
    assert_like_reference(gaussians, camera, RenderOptions())


def test_it_matches_the_reference_with_oblong_pixels_and_a_principal_point_off_centre() -> None:
    K = [[90.0, 0, 11.0], [0, 60.0, 40.5], [0, 0, 1]]
    camera = Camera(front_camera().viewmat, np.asarray(K), 50, 45)
    assert_like_reference(random_gaussians(np.random.default_rng(4), MANY), camera, RenderOptions())


@pytest.mark.parametrize(
    "changed",
    [
        {"eps2d": 0.0},
        {"eps2d": 3.0},
        {"alpha_min": 0.1},
        {"sigma_extent": 1.5},
        {"near_plane": 3.8},
        {"far_plane": 4.1},
    ],
)
def test_it_matches_the_reference_at_every_threshold(changed: dict[str, float]) -> None:
    gaussians = random_gaussians(np.random.default_rng(5), MANY)
    changed_image = assert_like_reference(gaussians, front_camera(), RenderOptions(**changed))  # type: ignore[arg-type]
    plain_image = rasterize(gaussians, front_camera(), RenderOptions())
    assert np.abs(changed_image.colors - plain_image.colors).max() > 1 / 255


def test_a_crowded_tile_is_sorted_as_the_reference_sorts_it() -> None:
    rng = np.random.default_rng(6)
    gaussians = random_gaussians(rng, 4 * MANY)
    faint = Gaussians(
        gaussians.means * 0.05, gaussians.quats, gaussians.scales, gaussians.opacities * 0.02, gaussians.sh
    )
    assert_like_reference(faint, front_camera(20, 20), RenderOptions(alpha_min=1e-3))


def test_the_number_of_threads_does_not_change_a_bit() -> None:
    gaussians = random_gaussians(np.random.default_rng(7), 3 * MANY)
    one, again, two, five = (
        rasterize(gaussians, front_camera(67, 45), RenderOptions(threads=n)) for n in (1, 1, 2, 5)
    )
    for other in (again, two, five):
        assert one.colors.tobytes() == other.colors.tobytes()
        assert one.alphas.tobytes() == other.alphas.tobytes()
        assert one.depths is not None
        assert other.depths is not None
        assert one.depths.tobytes() == other.depths.tobytes()


def test_an_image_stays_as_it_is_when_the_next_one_is_drawn() -> None:
    gaussians = random_gaussians(np.random.default_rng(8), 50)
    first = rasterize(gaussians, front_camera(), RenderOptions())
    kept = first.colors.copy()
    rasterize(gaussians, front_camera(), RenderOptions(background=(1, 1, 1)))
    np.testing.assert_array_equal(first.colors, kept)


def test_nothing_in_view_is_the_background() -> None:
    camera = Camera.look_at((0, 0, -4), (0, 0, -8), (0, -1, 0), width=20, height=10, fov_y=40.0)
    image = rasterize(
        random_gaussians(np.random.default_rng(9), 50), camera, RenderOptions(background=(0.1, 0.2, 0.3))
    )
    assert image.visible == 0
    np.testing.assert_allclose(image.colors, np.broadcast_to([0.1, 0.2, 0.3], (10, 20, 3)), atol=1e-7)
    assert image.depths is not None
    assert not image.alphas.any()
    assert not image.depths.any()


def test_depths_are_left_out_when_nobody_wants_them() -> None:
    gaussians = random_gaussians(np.random.default_rng(10), 50)
    with_depths, without = (
        rasterize(gaussians, front_camera(), RenderOptions(depths=wanted)) for wanted in (True, False)
    )
    assert without.depths is None
    np.testing.assert_array_equal(with_depths.colors, without.colors)


def test_the_depth_of_a_wall_is_its_distance() -> None:
    side = np.linspace(-2, 2, 41)
    means = np.stack([*np.meshgrid(side, side, [1.0])], -1).reshape(-1, 3)
    n = len(means)
    wall = Gaussians(
        means,
        np.tile([1.0, 0, 0, 0], (n, 1)),
        np.tile([0.1, 0.1, 1e-4], (n, 1)),
        np.full(n, 0.9),
        np.zeros((n, 1, 3)),
    )
    camera = Camera.look_at((0, 0, -4), (0, 0, 0), (0, -1, 0), width=24, height=24, fov_y=30.0)
    depths = rasterize(wall, camera, RenderOptions()).depths
    np.testing.assert_allclose(depths, 5.0, atol=1e-3)


@given(seed=st.integers(0, 2**32 - 1), n=st.integers(0, 40))
@settings(max_examples=25, deadline=None)
def test_alphas_are_opacities_and_shuffling_changes_nothing(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    gaussians = random_gaussians(rng, n)
    image = rasterize(gaussians, front_camera(23, 19), RenderOptions())
    assert image.alphas.min() >= 0.0
    assert image.alphas.max() <= 1.0
    assert np.isfinite(image.colors).all()
    shuffled = rasterize(gaussians.take(rng.permutation(n)), front_camera(23, 19), RenderOptions())
    np.testing.assert_allclose(shuffled.colors, image.colors, atol=1e-4)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_moving_the_world_and_the_camera_together_changes_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    gaussians = random_gaussians(rng, 30, sh_degree=0)
    offset = rng.normal(size=3)
    moved = Gaussians(
        gaussians.means + offset, gaussians.quats, gaussians.scales, gaussians.opacities, gaussians.sh
    )
    there = Camera.look_at(
        np.array([0.3, 0.2, -4.0]) + offset, offset, (0, -1, 0), width=64, height=48, fov_y=40.0
    )
    here, away = (rasterize(g, c, RenderOptions()) for g, c in ((gaussians, front_camera()), (moved, there)))
    assert np.mean(np.abs(here.colors - away.colors)) < 1e-3
