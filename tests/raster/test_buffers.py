"""Memory is used again, and never under anybody's feet."""

from __future__ import annotations

import numpy as np
import pytest

from tests.raster.compare import assert_like_reference, front_camera
from tests.scenes import random_gaussians
from tsplat.raster import rasterize
from tsplat.raster.buffers import CACHE_LINE, Buffers, aligned
from tsplat.raster.prepare import prepared
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians


@pytest.mark.parametrize("length", [0, 1, 1000])
def test_aligned_arrays_start_a_cache_line(length: int) -> None:
    array = aligned(length, np.float32)
    assert array.shape == (length,)
    assert array.ctypes.data % CACHE_LINE == 0 or not length


def test_an_array_grows_and_never_shrinks() -> None:
    buffers = Buffers()
    small = buffers.array("x", 10, np.int64)
    large = buffers.array("x", len(small) + 1, np.int64)
    assert len(large) > len(small)
    assert buffers.array("x", 1, np.int64) is large


def test_an_image_is_handed_out_again_only_when_nobody_holds_any_part_of_it() -> None:
    buffers = Buffers()
    image = buffers.image(4, 5, 3)
    place, corner = image.ctypes.data, image[:2, :2]
    assert buffers.image(4, 5, 3).ctypes.data != place
    del image
    assert buffers.image(4, 5, 3).ctypes.data != place
    del corner
    assert place in {buffers.image(4, 5, 3).ctypes.data, buffers.image(2, 2).ctypes.data}


@pytest.mark.parametrize("shape", [(4, 5, 3), (1,), (64, 64)])
def test_an_image_starts_a_cache_line(shape: tuple[int, ...]) -> None:
    buffers = Buffers()
    images = [buffers.image(*shape) for _ in range(12)]  # the last ones are not kept
    assert [each.ctypes.data % CACHE_LINE for each in images] == [0] * 12
    assert {each.shape for each in images} == {shape}
    images.clear()
    again = [buffers.image(*shape) for _ in range(8)]
    assert [each.ctypes.data % CACHE_LINE for each in again] == [0] * 8


def test_frames_one_after_the_other_share_their_memory() -> None:
    gaussians = random_gaussians(np.random.default_rng(0), 50)
    places, image = set(), None
    for _ in range(6):
        image = rasterize(gaussians, front_camera(), RenderOptions())
        places.add(image.colors.ctypes.data)
    assert len(places) <= 2
    buffers = prepared(gaussians, 1).buffers
    before = {name: array.ctypes.data for name, array in buffers._arrays.items()}
    rasterize(gaussians, front_camera(), RenderOptions())
    assert before == {name: array.ctypes.data for name, array in buffers._arrays.items()}


def test_a_frame_that_needs_more_room_than_the_last_is_drawn_in_full() -> None:
    cloud = random_gaussians(np.random.default_rng(1), 12)
    giants = Gaussians(cloud.means, cloud.quats, cloud.scales * 0 + 2.0, cloud.opacities * 0.2, cloud.sh)
    image = assert_like_reference(giants, front_camera(128, 96), RenderOptions(threads=2))
    assert image.pairs > 4 * len(giants)
    assert image.blends > image.pairs


@pytest.mark.parametrize("size", [(64, 48), (48, 57), (57, 48)])
@pytest.mark.parametrize("depths", [False, True])
def test_an_image_that_is_written_past_the_caches_is_the_same(
    monkeypatch: pytest.MonkeyPatch, size: tuple[int, int], depths: bool
) -> None:
    cloud = random_gaussians(np.random.default_rng(2), 40)
    camera, options = front_camera(*size), RenderOptions(depths=depths, background=(0.1, 0.2, 0.3), threads=2)
    kept = rasterize(cloud, camera, options)
    monkeypatch.setattr("tsplat.raster.frame.CACHES", 0)
    past = rasterize(cloud, camera, options)
    for name in ("colors", "alphas", *(["depths"] if depths else [])):
        np.testing.assert_array_equal(getattr(past, name), getattr(kept, name))
