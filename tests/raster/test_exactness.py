"""Where float32 and few bits would show: against the reference, which orders and sums in float64."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from tests.raster.compare import psnr
from tests.scenes import random_gaussians
from tsplat._jit import JIT
from tsplat.camera import Camera
from tsplat.drawing import draw_all
from tsplat.lod import open_stored, store
from tsplat.raster import rasterize, reference
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians

pytestmark = pytest.mark.skipif(not JIT, reason="thousands of splats; the compiled run is enough")

SIZE = {"width": 80, "height": 60}
ONE_THREAD = RenderOptions(threads=1)


def agreement(gaussians: Gaussians, camera: Camera) -> float:
    """Return how close the fast renderer comes to the reference, in dB."""
    return psnr(
        rasterize(gaussians, camera, ONE_THREAD).colors, reference.rasterize(gaussians, camera, ONE_THREAD).colors
    )


def wall(thickness: float, depth: float, n: int = 5000) -> Gaussians:
    """Return flat splats that face +z, mixed up, within so much of one depth."""
    rng = np.random.default_rng(1)
    means = np.column_stack([rng.uniform(-1.5, 1.5, (n, 2)), depth + rng.uniform(0.0, thickness, n)])
    scales = np.column_stack([rng.uniform(0.02, 0.1, (n, 2)), np.full(n, 1e-4)])
    return Gaussians(
        means,
        np.tile([1.0, 0, 0, 0], (n, 1)),
        scales,
        rng.uniform(0.3, 0.99, n),
        rng.uniform(-1.5, 1.5, (n, 1, 3)),
    )


def needles(n: int, sigma: float, ratio: float) -> Gaussians:
    rng = np.random.default_rng(7)
    quats = rng.normal(size=(n, 4))
    quats /= np.linalg.norm(quats, axis=1, keepdims=True)
    scales = np.tile([sigma, sigma / ratio, sigma / ratio], (n, 1))
    return Gaussians(rng.uniform(-1, 1, (n, 3)), quats, scales, np.full(n, 0.9), rng.uniform(-1.5, 1.5, (n, 1, 3)))


@pytest.mark.parametrize("thickness", [1e-5, 1e-3, 1e-2])
def test_a_wall_seen_face_on_is_in_order_however_thin_it_is(thickness: float) -> None:
    camera = Camera.look_at((0, 0, 0), (0, 0, 1), (0, -1, 0), fov_y=40.0, **SIZE)
    assert agreement(wall(thickness, 4.0), camera) > 75.0


def test_order_in_depth_does_not_depend_on_what_lies_far_away() -> None:
    near, far = wall(1e-5, 4.0), wall(1.0, 40_000.0, 50)
    both = Gaussians(*(np.concatenate(each) for each in zip(near.arrays, far.arrays, strict=True)))
    camera = Camera.look_at((0, 0, 0), (0, 0, 1), (0, -1, 0), fov_y=40.0, **SIZE)
    assert agreement(both, camera) > 75.0


@pytest.mark.parametrize("times", [4.5, 18.0])
def test_a_scene_far_away_through_a_long_lens_is_as_exact_as_a_near_one(times: float) -> None:
    gaussians = random_gaussians(np.random.default_rng(3), 3000)
    fov_y = float(np.degrees(2 * np.arctan(np.tan(np.radians(20)) / times)))
    eye = (1.2 * times, 0.8 * times, -3.8 * times)
    assert agreement(gaussians, Camera.look_at(eye, (0, 0, 0), (0, -1, 0), fov_y=fov_y, **SIZE)) > 80.0


def test_a_field_of_view_of_174_degrees_is_exact() -> None:
    gaussians = random_gaussians(np.random.default_rng(3), 3000)
    camera = Camera.look_at((0.2, 0.1, -0.6), (0, 0, 0.2), (0, -1, 0), fov_y=174.0, **SIZE)
    assert agreement(gaussians, camera) > 75.0


@pytest.mark.parametrize(("sigma", "ratio"), [(4.0, 1e3), (30.0, 1e3), (100.0, 1e3), (100.0, 1e4)])
def test_needles_longer_than_the_image_are_as_long_as_they_should_be(sigma: float, ratio: float) -> None:
    camera = Camera.look_at((0.3, 0.2, -4.0), (0, 0, 0), (0, -1, 0), width=160, height=120, fov_y=40.0)
    assert agreement(needles(60, sigma, ratio), camera) > 75.0


def test_needles_on_disk_are_drawn_as_those_in_memory(tmp_path: Path) -> None:
    path, scene = tmp_path / "scene.tsplat", needles(300, 30.0, 1e4)
    with path.open("wb") as file:
        store(file, scene, 1, lambda _: None)
    camera = Camera.look_at((0.3, 0.2, -4.0), (0, 0, 0), (0, -1, 0), width=160, height=120, fov_y=40.0)
    on_disk, in_memory = (draw_all(each, camera, ONE_THREAD) for each in (open_stored(path), scene))
    assert on_disk.colors.tobytes() == in_memory.colors.tobytes()


@pytest.mark.parametrize("antialias", ["mip", "relative"])
def test_needles_keep_the_opacity_that_antialiasing_gives_them(antialias: str) -> None:
    camera = Camera.look_at((0.3, 0.2, -4.0), (0, 0, 0), (0, -1, 0), width=160, height=120, fov_y=40.0)
    options = RenderOptions(threads=1, antialias=antialias, train_focal=600.0)  # type: ignore[arg-type]
    fast, slow = (draw(needles(20, 10.0, 1000.0), camera, options) for draw in (rasterize, reference.rasterize))
    assert psnr(fast.colors, slow.colors) > 70.0


def test_the_depth_of_a_flat_wall_is_that_of_its_splats() -> None:
    camera = Camera.look_at((0, 0, -4), (0, 0, 0), (0, -1, 0), fov_y=30.0, **SIZE)
    image = rasterize(wall(0.0, 1.0), camera, ONE_THREAD)
    assert image.depths is not None
    np.testing.assert_allclose(image.depths[image.alphas > 0.5], 5.0, rtol=1e-6)


@pytest.mark.parametrize("thickness", [1e-3, 1e-2])
def test_a_wall_does_not_flicker_as_the_camera_comes_nearer(thickness: float) -> None:
    turn = np.radians(40.0)
    axes = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    flat = wall(thickness, 0.0, 1000)
    turned = np.tile([np.cos(turn / 2), 0, np.sin(turn / 2), 0], (1000, 1))
    slanted = replace(flat, means=flat.means.astype(np.float64) @ axes.T, quats=turned)
    cameras = [
        Camera.look_at(axes @ [0, 0, -4 + 1e-3 * step], (0, 0, 0), (0, -1, 0), fov_y=40.0, **SIZE)
        for step in range(4)
    ]

    def changes(draw: object) -> float:
        frames = [draw(slanted, camera, ONE_THREAD).colors for camera in cameras]  # type: ignore[operator]
        return float(np.mean([np.abs(after - before) for before, after in pairwise(frames)]))

    assert changes(rasterize) < 1.3 * changes(reference.rasterize)
