"""Writing compressed PLY files: what comes back, and in which order."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

from tests.io.compressed_plys import (
    BOUNDS,
    COLOR_BOUNDS,
    SCALE_BOUNDS,
    assert_within_a_step,
    check,
    matched,
    read_tables,
    slow_splat,
    start_camera,
)
from tests.raster.compare import psnr
from tests.scenes import random_gaussians, shared_scenes
from tsplat import io
from tsplat.io import compressed_ply_write
from tsplat.raster import rasterize
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians

SCENES = shared_scenes()


def saved(folder: Path, gaussians: Gaussians) -> Path:
    path = folder / "scene.compressed.ply"
    with path.open("wb") as file:
        compressed_ply_write.write(file, gaussians)
    return path


@pytest.mark.parametrize("sh_degree", range(4))
@pytest.mark.parametrize("count", [1, 255, 256, 257, 1300])
def test_saving_keeps_every_value_within_a_step(
    tmp_path: Path, rng: np.random.Generator, sh_degree: int, count: int
) -> None:
    before = random_gaussians(rng, count, sh_degree)
    after = io.load(saved(tmp_path, before))
    assert after.sh.shape == before.sh.shape
    assert_within_a_step(matched(before, after), after)


def test_saving_writes_what_the_slow_reader_reads(tmp_path: Path, rng: np.random.Generator) -> None:
    before = random_gaussians(rng, 300, 2)
    path = saved(tmp_path, before)
    elements = read_tables(path.read_bytes())
    assert [(table.name, len(table.rows)) for table in elements] == [("chunk", 2), ("vertex", 300), ("sh", 300)]
    assert [name for _, name in elements[0].columns] == [*BOUNDS, *SCALE_BOUNDS, *COLOR_BOUNDS]
    check(io.load(path), elements)
    for axis in range(3):
        values = before.means[:, axis].tolist()
        assert min(row[axis] for row in elements[0].rows) == min(values), "bounds are values of splats to the bit"
        assert max(row[3 + axis] for row in elements[0].rows) == max(values)


def test_saving_and_loading_draws_the_same_picture(tmp_path: Path, rng: np.random.Generator) -> None:
    before = random_gaussians(rng, 4000, 3)
    camera = start_camera(before)
    images = [
        rasterize(each, camera, RenderOptions()).colors for each in (io.load(saved(tmp_path, before)), before)
    ]
    assert np.ptp(images[1]) > 0.5
    assert psnr(*images) >= 40.0


def test_splats_are_written_along_the_morton_curve(rng: np.random.Generator) -> None:
    cells = rng.permutation(np.stack(np.meshgrid(*[np.arange(16)] * 3), -1).reshape(-1, 3))
    # A cube of side 15 is divided into 2 ** 21 - 1 steps: the corner cells' codes keep the order of the cells'.
    codes = [int("".join(f"{z:04b}"[i] + f"{y:04b}"[i] + f"{x:04b}"[i] for i in range(4)), 2) for x, y, z in cells]
    order = compressed_ply_write.morton_order(cells.astype(np.float32))
    assert [codes[i] for i in order] == sorted(codes)


def test_chunks_are_small_where_the_scene_was_in_no_order(tmp_path: Path, rng: np.random.Generator) -> None:
    path = saved(tmp_path, random_gaussians(rng, 20_000, 0))
    bounds = np.array(read_tables(path.read_bytes())[0].rows)
    volumes = np.prod(bounds[:, 3:6] - bounds[:, :3], axis=1)
    assert np.median(volumes) < 0.05 * np.prod(bounds[:, 3:6].max(0) - bounds[:, :3].min(0))


def test_saving_keeps_the_ends_of_every_range(tmp_path: Path) -> None:
    before = Gaussians(
        np.array([[-3e38, 0, 1e-40], [3e38, 0, 0]], np.float32),
        np.array([[0, 0, 0, -1], [1, 0, 0, 0]], np.float32),
        np.array([[0, 1, 1], [3e38, 1, 1]], np.float32),
        np.array([0, 1], np.float32),
        np.array([[[-9, 0, 9]] * 4, [[9, 0, -9]] * 4], np.float32),
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with (tmp_path / "scene.ply").open("wb") as file:
            compressed_ply_write.write(file, before)
        chunk, vertex, rest = read_tables((tmp_path / "scene.ply").read_bytes())
    # What is seen is the bulk; the other has a chunk of its own.
    found = [
        slow_splat(list(chunk.rows[i]), list(vertex.rows[256 * i]), list(rest.rows[256 * i])) for i in range(2)
    ]
    for splat, truth in zip(found, (1, 0), strict=True):
        np.testing.assert_allclose(splat["means"], before.means[truth], rtol=1e-6)
        np.testing.assert_allclose(np.abs(splat["quats"]), np.abs(before.quats[truth]), atol=2e-3)
        np.testing.assert_allclose(np.log(splat["scales"]), [40.0 * truth - 20.0, 0, 0], atol=1e-6)
        assert splat["opacities"] == [truth]
        np.testing.assert_allclose(splat["sh"][:3], before.sh[truth, 0], atol=1e-5)
        np.testing.assert_allclose(splat["sh"][3:], np.clip(before.sh[truth, 1:], -4, 4).ravel(), atol=1 / 60)


def test_a_scene_of_no_splats_is_saved_as_one(tmp_path: Path, rng: np.random.Generator) -> None:
    gaussians = io.load(saved(tmp_path, random_gaussians(rng, 0, 1)))
    assert gaussians.sh.shape == (0, 4, 3)


@pytest.mark.skipif(SCENES is None, reason="no folder of real scenes: set TSPLAT_SCENES or have ../shared/scenes")
def test_saving_a_real_scene_is_as_good_as_its_compressed_twin(tmp_path: Path) -> None:
    assert SCENES is not None
    truth = io.load(SCENES / "format_matrix" / "yashica.ply")
    found = io.load(saved(tmp_path, truth))
    assert_within_a_step(matched(truth, found), found)
    camera = start_camera(truth)
    ours, theirs, image = (
        rasterize(each, camera, RenderOptions()).colors
        for each in (found, io.load(SCENES / "format_matrix" / "yashica.compressed.ply"), truth)
    )
    assert psnr(ours, image) >= max(40.0, psnr(theirs, image) - 1.0)
