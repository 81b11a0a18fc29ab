"""Each stage by itself against its slow twin."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.raster.compare import front_camera
from tests.scenes import random_gaussians
from tsplat._jit import JIT, Kernel, kernel
from tsplat.camera import Camera
from tsplat.raster import record, reference
from tsplat.raster.bin import bin_tiles
from tsplat.raster.cells import CELL, GRID, SHAPES, TILE, touch
from tsplat.raster.falloff import LOG2_E, OFFSET, SCALE
from tsplat.raster.frame import Frame, depth_key, new_frame
from tsplat.raster.prepare import BLOCK, prepared
from tsplat.raster.project import project
from tsplat.raster.sight import in_sight
from tsplat.raster.sort import sort
from tsplat.raster.workers import on_threads
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians

MANY = 700 if JIT else 90
PROJECT, SORT, BIN_TILES = kernel(project), kernel(sort), kernel(bin_tiles)


@kernel
def _in_sight(block, numbers, bounds):  # type: ignore[no-untyped-def]
    return in_sight(block, numbers, bounds)


TOUCH = kernel(touch)


def levels_of(options: RenderOptions) -> tuple[np.float32, np.float32]:
    """Return the least level that is drawn, and how far below its peak a splat is drawn at most."""
    drop = 0.5 * LOG2_E * SCALE * options.sigma_extent**2
    return np.float32(SCALE * np.log2(options.alpha_min) + OFFSET), np.float32(drop)


def cells_of(
    records: npt.NDArray[np.float32], corner: tuple[int, int], options: RenderOptions
) -> npt.NDArray[np.uint16]:
    """Return which cells of the tile with this corner each record touches."""
    found = [np.empty(0, np.uint16)]
    for first in range(0, len(records), 8):
        # What is left of eight repeats the first: no record is without an ellipse.
        eight = records[[*range(first, min(first + 8, len(records))), *[first] * 8][:8]]
        shapes, touched = np.zeros(SHAPES, np.float32), np.zeros(8, np.uint16)
        shapes[: eight.size] = eight.ravel()
        TOUCH(shapes, *levels_of(options), *corner, touched, 0)
        found.append(touched[: len(records) - first])
    return np.concatenate(found)


def colors_of(records: npt.NDArray[np.float32]) -> npt.NDArray[np.float16]:
    return np.ascontiguousarray(records[:, record.COLOR :]).view(np.float16)[:, :3]


def after(
    stages: list[Kernel[..., Any]],
    gaussians: Gaussians,
    camera: Camera,
    options: RenderOptions,
    pairs: int = 20_000,
) -> tuple[Frame, npt.NDArray[np.intp]]:
    """Return a frame after these stages, and the places of its records in the order of the file."""
    scene = prepared(gaussians, options.worker_count)
    frame = new_frame(scene, scene.blocks, camera, options, pairs)
    for stage in stages:
        on_threads(options.worker_count, frame.team, stage.on(frame))
    return frame, np.concatenate([np.arange(n) + block * BLOCK for block, n in enumerate(frame.visible)])


def records_of(frame: Frame) -> npt.NDArray[np.float32]:
    return frame.records.reshape(-1, record.LENGTH)


def projected(
    gaussians: Gaussians, camera: Camera, options: RenderOptions
) -> tuple[npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any]]:
    """Return what the reference makes of every splat: 2D means, depths, conics, opacities."""
    covars = reference.covariances(gaussians.quats, gaussians.scales)
    means2d, depths, covars2d = reference.project(gaussians.means, covars, camera)
    return means2d, depths, *reference.dilate(covars2d, gaussians.opacities, camera, options)


def splats_of(records: npt.NDArray[np.float32], means2d: npt.NDArray[Any]) -> npt.NDArray[np.intp]:
    """Return which splat each record is, by its centre."""
    apart = np.linalg.norm(records[:, None, [record.X, record.Y]] + 0.5 - means2d[None], axis=2)
    nearest: npt.NDArray[np.intp] = apart.argmin(1)
    return nearest


def test_prepared_covariances_are_those_of_the_reference() -> None:
    gaussians = random_gaussians(np.random.default_rng(0), 700)
    upper = reference.covariances(gaussians.quats, gaussians.scales)[:, *np.triu_indices(3)]
    covars = prepared(gaussians, 2).covars.reshape(6, -1)[:, :700]
    np.testing.assert_allclose(covars.T, upper, atol=1e-7)


def test_a_scene_is_prepared_once_and_forgotten_with_it() -> None:
    gaussians = random_gaussians(np.random.default_rng(0), 5)
    assert prepared(gaussians, 1) is prepared(gaussians, 2)
    assert prepared(gaussians.take(range(5)), 1) is not prepared(gaussians, 1)


def test_projected_records_are_those_of_the_reference_in_the_order_of_the_file() -> None:
    gaussians, camera, options = random_gaussians(np.random.default_rng(1), MANY), front_camera(), RenderOptions()
    frame, rows = after([PROJECT], gaussians, camera, options)
    means2d, depths, conics, opacities = projected(gaussians, camera, options)
    records = records_of(frame)[rows]
    ids = splats_of(records, means2d)
    assert len(ids) > MANY // 3
    assert (np.diff(ids) > 0).all()
    np.testing.assert_allclose(records[:, [record.X, record.Y]] + 0.5, means2d[ids], atol=1e-4)
    keys = [depth_key(depth) - depth_key(options.near_plane) for depth in depths[ids]]
    assert (np.abs(frame.depth_keys[rows].astype(np.int64) - np.array(keys)) <= 1).all()
    np.testing.assert_allclose(2.0 ** ((records[:, record.PEAK] - OFFSET) / SCALE), opacities[ids], rtol=1e-4)
    folded = conics[ids] * (-0.5 * np.log2(np.e) * SCALE)
    np.testing.assert_allclose(records[:, record.CONIC_A], folded[:, 0, 0], rtol=2e-4, atol=1e-6)
    np.testing.assert_allclose(records[:, record.CONIC_B], 2 * folded[:, 0, 1], rtol=2e-4, atol=1e-5)
    np.testing.assert_allclose(records[:, record.CONIC_C], folded[:, 1, 1], rtol=2e-4, atol=1e-6)


def test_records_are_the_same_past_the_caches() -> None:
    gaussians, camera = random_gaussians(np.random.default_rng(7), MANY), front_camera()
    frame, rows = after([PROJECT], gaussians, camera, RenderOptions(threads=1))
    expected, visible = records_of(frame)[rows].copy(), frame.visible.copy()
    assert not frame.past_caches
    frame.records[:] = 0
    frame.team[:] = 0
    PROJECT(0, frame._replace(past_caches=True))
    np.testing.assert_array_equal(frame.visible, visible)
    np.testing.assert_array_equal(records_of(frame)[rows], expected)


@pytest.mark.parametrize("antialias", ["classic", "mip", "relative"])
def test_a_block_out_of_sight_has_no_splat_in_the_image(antialias: str) -> None:
    rng = np.random.default_rng(8)
    options = RenderOptions(antialias=antialias, train_focal=500.0)
    hidden = 0
    for _ in range(30 if JIT else 8):
        many = random_gaussians(rng, 4 * BLOCK if JIT else BLOCK + 9)
        places = np.repeat(rng.normal(0, 3, (4, 3)), BLOCK, axis=0)[: len(many)]
        gaussians = replace(many, means=many.means * np.float32(rng.uniform(0.1, 2)) + places)
        camera = Camera.look_at(
            rng.normal(0, 2, 3), rng.normal(0, 1, 3), (0, -1, 0), width=64, height=40, fov_y=rng.uniform(20, 110)
        )
        frame, _ = after([PROJECT], gaussians, camera, options)
        unseen = [not _in_sight(block, frame.numbers, frame.bounds) for block in range(len(frame.visible))]
        hidden += sum(unseen)
        means2d, depths, conics, opacities = projected(gaussians, camera, options)
        for block in np.flatnonzero(unseen):
            assert frame.visible[block] == 0
            own = slice(block * BLOCK, (block + 1) * BLOCK)
            ys, xs = np.mgrid[0.5:40:2, 0.5:64:2]
            ahead = (depths[own] > options.near_plane) & (depths[own] < options.far_plane)
            alphas = reference._alphas(
                means2d[own][ahead], conics[own][ahead], opacities[own][ahead],
                np.stack([xs.ravel(), ys.ravel()], -1), options,
            )  # fmt: skip
            assert not (alphas > options.alpha_min).any()
    assert hidden > (20 if JIT else 2)


def test_every_pixel_a_splat_may_touch_lies_in_its_tiles_and_cells() -> None:
    gaussians, camera, options = random_gaussians(np.random.default_rng(2), 200), front_camera(), RenderOptions()
    frame, rows = after([PROJECT], gaussians, camera, options)
    means2d, _, conics, opacities = projected(gaussians, camera, options)
    ids = splats_of(records_of(frame)[rows], means2d)
    ys, xs = np.mgrid[0.5 : camera.height, 0.5 : camera.width]
    alphas = reference._alphas(means2d, conics, opacities, np.stack([xs.ravel(), ys.ravel()], -1), options)
    seen = (alphas > options.alpha_min * 1.001).reshape(-1, camera.height, camera.width)
    assert set(np.flatnonzero(seen.any((1, 2)))) <= set(ids)
    tiles = frame.tiles.view(np.uint32).reshape(-1, 2)
    corners = [(x, y) for y in range(0, camera.height, TILE) for x in range(0, camera.width, TILE)]
    touched = {corner: cells_of(records_of(frame)[rows], corner, options) for corner in corners}
    for place, (row, splat) in enumerate(zip(rows, ids, strict=True)):
        (left, right), (top, bottom) = tiles[row] & 0xFFFF, tiles[row] >> 16
        for y, x in zip(*np.nonzero(seen[splat]), strict=True):
            assert left <= x // TILE <= right
            assert top <= y // TILE <= bottom
            corner = x // TILE * TILE, y // TILE * TILE
            cell = (y - corner[1]) // CELL * GRID + (x - corner[0]) // CELL
            assert touched[corner][place] >> cell & 1


@given(
    covariance=st.tuples(st.floats(0.3, 400), st.floats(0.3, 400), st.floats(-0.99, 0.99)),
    x=st.floats(-30, 46),
    y=st.floats(-30, 46),
    radius=st.floats(0.3, 3.3),
)
@settings(max_examples=300 if JIT else 50, deadline=None)
def test_cells_are_touched_exactly_where_the_ellipse_reaches_a_column_of_pixels(
    covariance: tuple[float, float, float], x: float, y: float, radius: float
) -> None:
    xx, yy, correlation = covariance
    xy = correlation * np.sqrt(xx * yy)
    variance = xx - xy * xy / yy
    options = RenderOptions()
    one, fold = np.zeros((1, record.LENGTH), np.float32), -0.5 * LOG2_E * SCALE
    one[0, [record.X, record.Y]] = x, y
    one[0, record.CONIC_A : record.CONIC_C + 1] = np.array([yy, -2 * xy, xx]) * fold / (xx * yy - xy**2)
    one[0, record.PEAK] = levels_of(options)[0] - fold * radius**2
    found = int(cells_of(one, (0, 0), options)[0])
    for row in range(GRID):
        heights = np.linspace(row * CELL, row * CELL + CELL - 1, 3001) - y
        half2 = variance * radius**2 - variance / yy * heights**2
        if half2.max() < 0:
            assert found >> (4 * row) & 15 == 0 or half2.max() > -0.05
            continue
        middle, half = x + xy / yy * heights[half2 >= 0], np.sqrt(half2[half2 >= 0])
        left, right = (middle - half).min(), (middle + half).max()
        for column in range(GRID):
            # Its pixels' centres, and as far as rounding and the steps above may be wrong.
            slack, first, last = 0.02 + 0.02 * np.sqrt(xx), column * CELL, column * CELL + CELL - 1
            touched = bool(found >> (4 * row + column) & 1)
            assert touched or not (left + slack < last and first < right - slack and left + slack < right - slack)
            assert not touched or (left - slack <= last and first <= right + slack)


@pytest.mark.parametrize("degree", [0, 1, 2, 3, 4])
def test_colours_are_those_of_the_reference_to_half_precision(degree: int) -> None:
    gaussians, camera = random_gaussians(np.random.default_rng(3), MANY, max(3, degree)), front_camera()
    options = RenderOptions(sh_degree=degree)
    frame, rows = after([PROJECT], gaussians, camera, options)
    records = records_of(frame)[rows]
    ids = splats_of(records, projected(gaussians, camera, options)[0])
    expected = reference.evaluate_sh(gaussians.sh, gaussians.means - camera.eye, degree)[ids]
    np.testing.assert_allclose(colors_of(records), expected, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("threads", [1, 3])
def test_records_are_sorted_by_depth_and_equal_depths_keep_their_order(threads: int) -> None:
    gaussians, camera = random_gaussians(np.random.default_rng(4), 2 * MANY), front_camera(70, 50)
    doubled = gaussians.take(np.repeat(np.arange(2 * MANY), 2))
    frame, rows = after([PROJECT, SORT], doubled, camera, RenderOptions(threads=threads))
    order = frame.order[: len(rows)]
    np.testing.assert_array_equal(order, rows[np.argsort(frame.depth_keys[rows], kind="stable")])
    means2d, depths, *_ = projected(doubled, camera, RenderOptions())
    by_depth = depths[splats_of(records_of(frame)[order], means2d)]
    assert (by_depth[1:] >= by_depth[:-1] * (1 - 2e-8)).all()


@pytest.mark.parametrize("threads", [1, 3])
def test_every_tile_lists_the_splats_whose_boxes_touch_it_by_depth_and_no_others(threads: int) -> None:
    gaussians, camera = random_gaussians(np.random.default_rng(5), 2 * MANY), front_camera(70, 50)
    frame, rows = after([PROJECT, SORT, BIN_TILES], gaussians, camera, RenderOptions(threads=threads))
    order = frame.order[: len(rows)]
    first, last = frame.tiles.view(np.uint32).reshape(-1, 2)[order].T
    ends = frame.tile_cursors[threads - 1]
    for tile, start in enumerate([0, *ends[:-1]]):
        y, x = divmod(tile, frame.tile_columns)
        beside = ((first & 0xFFFF) <= x) & (x <= (last & 0xFFFF))
        expected = order[beside & ((first >> 16) <= y) & (y <= (last >> 16))]
        np.testing.assert_array_equal(frame.isect_ids[start : ends[tile]], expected)


def test_workers_bin_about_as_much_each_where_the_nearest_splats_touch_most_tiles() -> None:
    many, workers = 10 * MANY, 3  # compiled, more than are looked at
    gaussians = random_gaussians(np.random.default_rng(7), many)
    inside = Camera.look_at((0, 0, 0.2), (0, 0, 1), (0, -1, 0), width=400, height=300, fov_y=60.0)
    options, room = RenderOptions(threads=workers), 100 * many
    frame, rows = after([PROJECT, SORT, BIN_TILES], gaussians, inside, options, room)
    left, top, right, bottom = frame.tiles.view(np.uint16).reshape(-1, 4)[frame.order[: len(rows)]].T.astype(int)
    tiles = (right - left + 1) * (bottom - top + 1)
    assert tiles.sum() == frame.tile_counts.sum()
    assert tiles[: len(tiles) // workers].sum() > 0.5 * tiles.sum()
    shares = frame.tile_counts.sum(1) / tiles.sum()
    np.testing.assert_allclose(shares, 1 / workers, atol=0.1)


def test_too_little_room_for_pairs_is_noticed_before_anything_is_written() -> None:
    gaussians, camera = random_gaussians(np.random.default_rng(6), MANY), front_camera(70, 50)
    options = RenderOptions(threads=1)
    frame, _ = after([PROJECT, SORT], gaussians, camera, options)
    short = frame._replace(isect_ids=np.full(10, -1, np.int32))
    assert BIN_TILES(0, short) == BIN_TILES(0, frame) > 10
    assert (short.isect_ids == -1).all()
