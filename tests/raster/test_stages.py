"""Each stage by itself against its slow twin."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.raster.compare import front_camera
from tests.scenes import random_gaussians
from tsplat.raster import record, reference
from tsplat.raster.bin import bin_tiles
from tsplat.raster.composite import TILE
from tsplat.raster.prepare import BLOCK, Prepared, prepared
from tsplat.raster.project import project
from tsplat.raster.sh import color_visible
from tsplat.raster.sort import MAX_BUCKETS, into_buckets, sort_bucket
from tsplat.rendering import DEPTH_BITS_IGNORED, RenderOptions


def visible_rows(scene: Prepared) -> np.ndarray:
    """Return the row of every record that the last frame wrote."""
    return np.concatenate([np.arange(n) + block * BLOCK for block, n in enumerate(scene.visible)])


def test_prepared_covariances_are_those_of_the_reference() -> None:
    gaussians = random_gaussians(np.random.default_rng(0), 700)
    upper = reference.covariances(gaussians.quats, gaussians.scales)[:, *np.triu_indices(3)]
    np.testing.assert_allclose(prepared(gaussians, 2).covars.T, upper, atol=1e-7)


def test_a_scene_is_prepared_once_and_forgotten_with_it() -> None:
    gaussians = random_gaussians(np.random.default_rng(0), 5)
    assert prepared(gaussians, 1) is prepared(gaussians, 2)
    assert prepared(gaussians.take(range(5)), 1) is not prepared(gaussians, 1)


def test_projected_records_are_those_of_the_reference() -> None:
    gaussians, camera, options = random_gaussians(np.random.default_rng(1), 700), front_camera(), RenderOptions()
    scene = prepared(gaussians, 1)
    count = project(scene, camera, options, TILE)
    rows = visible_rows(scene)
    assert count == len(rows) > 300
    ids, records = scene.ids[rows], scene.records[rows]
    means2d, depths, covars2d = reference.project(
        gaussians.means, reference.covariances(gaussians.quats, gaussians.scales), camera
    )
    conics, opacities = reference.dilate(covars2d, gaussians.opacities, camera, options)
    np.testing.assert_allclose(records[:, [record.X, record.Y]] + 0.5, means2d[ids], atol=1e-4)
    np.testing.assert_allclose(records[:, record.DEPTH], depths[ids], rtol=1e-6)
    np.testing.assert_allclose(2.0 ** records[:, record.LOG2_OPACITY], opacities[ids], rtol=1e-4)
    folded = conics[ids] * (-0.5 * np.log2(np.e))
    np.testing.assert_allclose(records[:, record.CONIC_A], folded[:, 0, 0], rtol=2e-4, atol=1e-6)
    np.testing.assert_allclose(records[:, record.CONIC_B], 2 * folded[:, 0, 1], rtol=2e-4, atol=1e-5)
    np.testing.assert_allclose(records[:, record.CONIC_C], folded[:, 1, 1], rtol=2e-4, atol=1e-6)


def test_a_record_s_box_holds_every_pixel_its_splat_may_touch() -> None:
    gaussians, camera, options = random_gaussians(np.random.default_rng(2), 300), front_camera(), RenderOptions()
    scene = prepared(gaussians, 1)
    project(scene, camera, options, TILE)
    rows = visible_rows(scene)
    ids, boxes = scene.ids[rows], scene.records[rows][:, [record.LEFT, record.TOP, record.RIGHT, record.BOTTOM]]
    means2d, _, covars2d = reference.project(
        gaussians.means, reference.covariances(gaussians.quats, gaussians.scales), camera
    )
    conics, opacities = reference.dilate(covars2d, gaussians.opacities, camera, options)
    ys, xs = np.mgrid[0.5 : camera.height, 0.5 : camera.width]
    pixels = np.stack([xs.ravel(), ys.ravel()], -1)
    alphas = reference._alphas(means2d, conics, opacities, pixels, options)
    seen = (alphas > options.alpha_min * 1.001).reshape(-1, camera.height, camera.width)
    assert set(np.flatnonzero(seen.any((1, 2)))) <= set(ids)
    for splat, (left, top, right, bottom) in zip(ids, boxes.astype(int), strict=True):
        touched_rows, touched_columns = np.nonzero(seen[splat])
        if len(touched_rows):
            assert left <= touched_columns.min() <= touched_columns.max() <= right
            assert top <= touched_rows.min() <= touched_rows.max() <= bottom


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_colours_are_those_of_the_reference(degree: int) -> None:
    gaussians, camera = random_gaussians(np.random.default_rng(3), 600), front_camera()
    options = RenderOptions(sh_degree=degree)
    scene = prepared(gaussians, 1)
    project(scene, camera, options, TILE)
    color_visible(scene, gaussians, camera, options)
    rows = visible_rows(scene)
    expected = reference.evaluate_sh(gaussians.sh, gaussians.means - camera.eye, degree)[scene.ids[rows]]
    np.testing.assert_allclose(scene.records[rows][:, record.RED : record.BLUE + 1], expected, atol=2e-6)


@pytest.mark.parametrize("threads", [1, 3])
def test_every_tile_lists_the_splats_whose_boxes_touch_it_and_no_others(threads: int) -> None:
    gaussians, camera = random_gaussians(np.random.default_rng(4), 1300), front_camera(70, 50)
    scene = prepared(gaussians, 1)
    project(scene, camera, RenderOptions(), TILE)
    columns, tile_rows = -(-70 // TILE), -(-50 // TILE)
    isect_offsets = bin_tiles(scene, columns, columns * tile_rows, threads)
    rows = visible_rows(scene)
    left, top, right, bottom = scene.tiles[rows].astype(int).T
    for tile in range(columns * tile_rows):
        y, x = divmod(tile, columns)
        expected = rows[(left <= x) & (x <= right) & (top <= y) & (y <= bottom)]
        keys = scene.isect_keys[isect_offsets[tile] : isect_offsets[tile + 1]]
        assert sorted(keys & np.uint64(0xFFFFFFFF)) == sorted(expected)
        depths = (keys >> np.uint64(32) << np.uint64(DEPTH_BITS_IGNORED)).astype(np.uint32).view(np.float32)
        np.testing.assert_allclose(
            depths, scene.records[(keys & np.uint64(0xFFFFFFFF)).astype(int), record.DEPTH], rtol=2e-5
        )


@given(
    keys=st.lists(
        st.integers(0, 2**63 - 1) | st.integers(2**60, 2**60 + 300), min_size=1, max_size=200, unique=True
    ),
    extra=st.integers(0, 5),
)
@settings(max_examples=100, deadline=None)
def test_buckets_one_after_the_other_are_the_sorted_keys(keys: list[int], extra: int) -> None:
    everything = np.array([7] * extra + keys, np.uint64)
    found, bucket_ends = np.zeros(len(keys), np.uint64), np.zeros(MAX_BUCKETS + 1, np.int64)
    buckets = into_buckets(everything, extra, len(everything), found, bucket_ends)
    first = 0
    for end in bucket_ends[:buckets]:
        sort_bucket(found, first, end)
        first = end
    assert first == len(keys)
    np.testing.assert_array_equal(found, np.sort(np.array(keys, np.uint64)))
