"""A scene on disk is drawn to the bit as the one in memory, and nothing in its file does more than look wrong."""

from __future__ import annotations

import io
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tsplat
from tests.raster.compare import front_camera, psnr
from tests.scenes import random_gaussians, shared_scenes
from tsplat._jit import JIT
from tsplat.camera import Camera
from tsplat.errors import CorruptFileError, LoadError
from tsplat.files import replacing
from tsplat.framing import start_pose
from tsplat.io import load, save, tsplat_header
from tsplat.io.tsplat_file import write
from tsplat.io.tsplat_header import Counts
from tsplat.io.tsplat_map import open_mapped
from tsplat.lod import Cut, Stored, hierarchy, open_stored, rasterize_all, rasterize_within, store
from tsplat.lod.cut import _choose
from tsplat.raster import prepare, rasterize
from tsplat.raster.draw import draw
from tsplat.rendering import ANTIALIAS, RenderOptions
from tsplat.scene import Gaussians
from tsplat.train_views import TrainViews

pytestmark = pytest.mark.skipif(not JIT, reason="thousands of splats take minutes without a compiler")

N = 20 * prepare.BLOCK - 5
CAMERA = front_camera(96, 64)
OPTIONS = RenderOptions(antialias="mip", depths=False, threads=2)
NEAR = Camera.look_at((0.1, 0.2, -1.2), (0, 0, 0), (0, -1, 0), width=96, height=64, fov_y=60.0)
KNOWN = RenderOptions(antialias="relative", train_focal=30.0, train_views=TrainViews.of([CAMERA]), threads=2)


def stored(path: Path, gaussians: Gaussians) -> Path:
    with replacing(path) as file:
        store(file, gaussians, 2, lambda _: None)
    return path


@pytest.fixture(scope="module")
def scene() -> Gaussians:
    cloud = random_gaussians(np.random.default_rng(0), N, 2)
    return Gaussians(cloud.means, cloud.quats, 0.2 * cloud.scales, *cloud.arrays[3:], antialiased=True)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory, scene: Gaussians) -> Path:
    return stored(tmp_path_factory.mktemp("stored") / "x.tsplat", scene)


@pytest.fixture(scope="module")
def on_disk(path: Path) -> Stored:
    return open_stored(path)


def test_the_format_has_the_blocks_of_the_kernels() -> None:
    assert tsplat_header.BLOCK == prepare.BLOCK
    assert prepare.BOUNDS == 5


def test_at_rest_it_is_drawn_to_the_bit_as_the_scene_that_is_loaded(on_disk: Stored, path: Path) -> None:
    ours, whole = rasterize_all(on_disk, CAMERA, OPTIONS), rasterize(load(path), CAMERA, OPTIONS)
    np.testing.assert_array_equal(ours.colors, whole.colors)
    np.testing.assert_array_equal(ours.alphas, whole.alphas)
    assert ours.visible == whole.visible > N // 2


def test_nearer_than_the_training_cameras_it_is_drawn_to_the_bit_as_the_scene_that_is_loaded(path: Path) -> None:
    fresh = open_stored(path)
    for _ in range(2):
        ours, theirs = rasterize_all(fresh, NEAR, KNOWN), rasterize(load(path), NEAR, KNOWN)
        np.testing.assert_array_equal(ours.colors, theirs.colors)
        fresh.let_go()
    without = rasterize_all(fresh, NEAR, replace(KNOWN, train_views=None))
    assert np.abs(ours.colors - without.colors).max() > 0.05


def test_it_looks_like_the_scene_that_was_stored(on_disk: Stored, scene: Gaussians) -> None:
    # Only splats at the same depth, which have no order of their own, may have changed places.
    ours, theirs = rasterize_all(on_disk, CAMERA, OPTIONS), rasterize(scene, CAMERA, OPTIONS)
    assert psnr(ours.colors, theirs.colors) > 60.0


def test_all_but_the_precision_of_harmonics_comes_back_in_another_order(path: Path, scene: Gaussians) -> None:
    back = load(path)
    assert (len(back), back.sh_degree, back.antialiased) == (N, 2, True)
    ours, theirs = (np.lexsort(each.means.T) for each in (back, scene))
    for name in ("means", "quats", "scales", "opacities"):
        np.testing.assert_array_equal(getattr(back, name)[ours], getattr(scene, name)[theirs])
    np.testing.assert_array_equal(back.sh[ours, 0], scene.sh[theirs, 0])
    np.testing.assert_array_equal(back.sh[ours, 1:], scene.sh[theirs, 1:].astype(np.float16))


def test_a_ply_made_of_it_looks_the_same(path: Path, tmp_path: Path, scene: Gaussians) -> None:
    ply = save(tmp_path / "x.ply", load(path))
    there, back = rasterize(scene, CAMERA, OPTIONS), rasterize(load(ply), CAMERA, OPTIONS)
    assert psnr(back.colors, there.colors) > 60.0


@pytest.mark.parametrize("budget", [1, 600, 2000, N])
def test_within_a_budget_it_is_drawn_as_from_memory(on_disk: Stored, scene: Gaussians, budget: int) -> None:
    ours = tsplat.render(on_disk, CAMERA, lod=budget, depths=False)
    theirs = tsplat.render(scene, CAMERA, lod=budget, depths=False)
    same = np.array_equal if budget < N else lambda a, b: psnr(a, b) > 60.0
    assert same(ours.colors, theirs.colors)


def test_the_start_view_is_that_of_the_scene_that_was_stored(on_disk: Stored, scene: Gaussians) -> None:
    ours, theirs = (start_pose(each, aspect=1.5, fov_y=50.0) for each in (on_disk.sample, scene))
    assert ours == theirs


def test_the_start_view_of_more_splats_than_are_sampled_is_the_same(tmp_path: Path) -> None:
    many = random_gaussians(np.random.default_rng(5), 20_000, 0)
    on_disk = open_stored(stored(tmp_path / "x.tsplat", many))
    assert len(on_disk.sample) == 6667
    ours, theirs = (start_pose(each, aspect=1.5, fov_y=50.0) for each in (on_disk.sample, many))
    assert ours == theirs


def test_the_levels_are_those_that_are_built(on_disk: Stored, scene: Gaussians) -> None:
    built = hierarchy(scene, 2)
    np.testing.assert_array_equal(on_disk.tree.children, built.children)
    np.testing.assert_array_equal(on_disk.tree.errors, built.errors)
    np.testing.assert_array_equal(on_disk.tree.solidities, built.solidities)
    np.testing.assert_array_equal(on_disk.tree.scene.covars, built.scene.covars)
    assert len(on_disk) == N
    assert (on_disk.sh_degree, on_disk.antialiased) == (2, True)


def test_no_kernel_is_compiled_for_files(path: Path, scene: Gaussians) -> None:
    rasterize(scene, CAMERA, OPTIONS)
    rasterize_within(scene, CAMERA, OPTIONS, 600)
    kernels: tuple[Any, ...] = draw, _choose
    before = [len(each.codes) for each in kernels]
    fresh = open_stored(path)
    rasterize_all(fresh, CAMERA, OPTIONS)
    rasterize_within(fresh, CAMERA, OPTIONS, 600)
    assert [len(each.codes) for each in kernels] == before


def test_looking_at_it_does_not_change_the_file(path: Path) -> None:
    before = path.read_bytes()
    fresh = open_stored(path)
    rasterize_all(fresh, CAMERA, OPTIONS)
    Cut(fresh.tree).blocks(CAMERA, OPTIONS, 600)
    assert path.read_bytes() == before


def test_what_was_let_go_is_drawn_again_as_before(path: Path) -> None:
    fresh = open_stored(path)
    before = rasterize_all(fresh, CAMERA, OPTIONS)
    kept = before.colors.copy()
    fresh.let_go()
    np.testing.assert_array_equal(rasterize_all(fresh, CAMERA, OPTIONS).colors, kept)
    np.testing.assert_array_equal(before.colors, kept)


def in_memory(path: Path) -> int:
    """Return how many kilobytes of a file this process holds."""
    lines = Path("/proc/self/smaps").read_text().splitlines()
    starts = [number for number, line in enumerate(lines) if line.endswith(str(path))]
    return sum(int(lines[start + 1 + row].split()[1]) for start in starts for row in range(6)
               if lines[start + 1 + row].startswith("Rss:"))  # fmt: skip


@pytest.mark.skipif(not Path("/proc/self/smaps").exists(), reason="only Linux tells")
def test_what_was_let_go_is_not_in_memory(path: Path, tmp_path: Path) -> None:
    own = tmp_path / "own.tsplat"
    own.write_bytes(path.read_bytes())
    fresh = open_stored(own)
    rasterize_all(fresh, CAMERA, OPTIONS)
    assert in_memory(own) > 500
    fresh.let_go()
    assert in_memory(own) == 0


SHRINKS = """
import os, sys, tsplat
from tsplat.errors import CorruptFileError
from tsplat.lod import Cut, open_stored, rasterize_all, rasterize_within
from tsplat.rendering import RenderOptions

path, options = sys.argv[1], RenderOptions(depths=False, threads=2)
camera = tsplat.Camera.look_at((0, -1, -4), (0, 0, 0), (0, -1, 0), width=48, height=32, fov_y=55.0)
scene = open_stored(path)
cut, whole = Cut(scene.tree), os.path.getsize(path)
ways = {
    "cut": lambda: cut.blocks(camera, options, 600),
    "all": lambda: rasterize_all(scene, camera, options),
    "within": lambda: rasterize_within(scene, camera, options, 600, cut),
    "render": lambda: tsplat.render(scene, camera),
    "lod": lambda: tsplat.render(scene, camera, lod=600),
}
for name, way in ways.items():
    os.truncate(path, whole)
    way()
    os.truncate(path, 5000)
    try:
        way()
    except CorruptFileError as error:
        print(name, error)
"""


def test_a_file_that_becomes_shorter_while_it_is_drawn_is_one_line_and_no_bus_error(
    path: Path, tmp_path: Path
) -> None:
    own = tmp_path / "own.tsplat"
    own.write_bytes(path.read_bytes())
    done = subprocess.run([sys.executable, "-c", SHRINKS, str(own)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert [line.split()[0] for line in lines] == ["cut", "all", "within", "render", "lod"]
    assert all("own.tsplat: at byte 5000: ends, but was longer when it was opened" in line for line in lines)


@pytest.mark.parametrize("n", [1, 255, 256, 257])
def test_few_splats_are_stored_as_well(tmp_path: Path, n: int) -> None:
    few = random_gaussians(np.random.default_rng(n), n, 0)
    on_disk = open_stored(stored(tmp_path / "x.tsplat", few))
    assert len(load(tmp_path / "x.tsplat")) == len(on_disk) == n
    assert psnr(rasterize_all(on_disk, CAMERA, OPTIONS).colors, rasterize(few, CAMERA, OPTIONS).colors) > 60.0


def test_the_file_is_the_same_whatever_the_number_of_threads(scene: Gaussians) -> None:
    one, three = io.BytesIO(), io.BytesIO()
    store(one, scene, 1, lambda _: None)
    store(three, scene, 3, lambda _: None)
    assert one.getvalue() == three.getvalue()


def test_the_progress_of_storing_grows_to_its_end(scene: Gaussians) -> None:
    heard: list[float] = []
    store(io.BytesIO(), scene, 2, heard.append)
    assert heard == sorted(heard)
    assert heard[-1] == 1.0


def test_what_cannot_be_read_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(LoadError, match="cannot be read"):
        open_stored(tmp_path / "none.tsplat")


def arrays_of(path: Path) -> dict[str, list[np.ndarray]]:  # type: ignore[type-arg]
    return {name: [array.copy()] for name, array in open_mapped(path).arrays.items()}


def test_blocks_that_form_no_tree_are_refused(tmp_path: Path, path: Path) -> None:
    counts = open_mapped(path).header.counts
    more = Counts(counts.splats, counts.blocks + 1, counts.coefficients, counts.sampled)
    arrays = {name: [np.zeros(length, dtype)] for name, (dtype, length) in more.arrays.items()}
    with (tmp_path / "x.tsplat").open("wb") as file:
        write(file, more, False, arrays)
    with pytest.raises(CorruptFileError, match=r"has 42 blocks of 5115 splats, expected 41"):
        open_stored(tmp_path / "x.tsplat")


GARBAGE = (
    "bounds", "sizes", "errors", "solidities", "means", "covars", "log2_opacities", "base_colors", "sh_rest",
)  # fmt: skip


def drawn_in_every_way(path: Path) -> None:
    """Draw what a file holds, which need not be a picture of anything; nothing beside the arrays is touched."""
    on_disk = open_stored(path)
    every_way = [RenderOptions(antialias=antialias, threads=2) for antialias in ANTIALIAS]
    for options in (*every_way, KNOWN):
        for budget in (0, 1500, N):
            picture = rasterize_within(on_disk, CAMERA, options, budget)
            assert 0 <= picture.visible <= N


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 3e38, -3e38, 1e-45, -1.0, 0.0])
@pytest.mark.parametrize("name", GARBAGE)
def test_garbage_in_a_file_ends_no_process(tmp_path: Path, path: Path, name: str, value: float) -> None:
    arrays, counts = arrays_of(path), open_mapped(path).header.counts
    array = arrays[name][0]
    if name == "sh_rest":
        array = array.view(np.float16)
    with np.errstate(over="ignore"):
        array[np.random.default_rng(1).random(len(array)) < 0.3] = value
    with (tmp_path / "x.tsplat").open("wb") as file:
        write(file, counts, False, arrays)
    drawn_in_every_way(tmp_path / "x.tsplat")


@pytest.mark.parametrize("seed", range(6))
def test_random_bytes_in_a_file_end_no_process(tmp_path: Path, path: Path, seed: int) -> None:
    arrays, counts, rng = arrays_of(path), open_mapped(path).header.counts, np.random.default_rng(seed)
    for name in GARBAGE:
        raw = arrays[name][0].view(np.uint8)
        chosen = rng.random(len(raw)) < (1.0 if seed == 0 else 0.05)
        raw[chosen] = rng.integers(0, 256, int(chosen.sum()), np.uint8)
    with (tmp_path / "x.tsplat").open("wb") as file:
        write(file, counts, False, arrays)
    drawn_in_every_way(tmp_path / "x.tsplat")


def test_a_real_scene_is_drawn_to_the_bit_as_it_is_loaded(tmp_path: Path) -> None:
    if (folder := shared_scenes()) is None:
        pytest.skip("no folder of real scenes")
    plant = load(folder / "ply" / "plant.ply")
    path = stored(tmp_path / "plant.tsplat", plant)
    camera = start_pose(plant, aspect=1.5, fov_y=50.0).camera(240, 160, 50.0)
    on_disk = rasterize_all(open_stored(path), camera, OPTIONS)
    np.testing.assert_array_equal(on_disk.colors, rasterize(load(path), camera, OPTIONS).colors)
    assert psnr(on_disk.colors, rasterize(plant, camera, OPTIONS).colors) > 60.0
