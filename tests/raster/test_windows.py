"""Images that are drawn in parts are those that are drawn at once, to the bit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.raster.compare import front_camera
from tests.scenes import random_gaussians
from tsplat import memory
from tsplat._jit import JIT
from tsplat.camera import Camera
from tsplat.raster import rasterize, windows
from tsplat.raster.buffers import Buffers
from tsplat.raster.frame import PAIR_BYTES, SPLAT_BYTES, Window
from tsplat.raster.prepare import BLOCK
from tsplat.rendering import Antialias, Rendering, RenderOptions

MANY = 3000 if JIT else 300


def bits(image: Rendering) -> bytes:
    assert image.depths is not None
    return image.colors.tobytes() + image.alphas.tobytes() + image.depths.tobytes()


@pytest.mark.parametrize("antialias", ["classic", "relative"])
@pytest.mark.parametrize("width", [83, 16])
def test_an_image_in_parts_has_the_bits_of_one_at_once(antialias: Antialias, width: int) -> None:
    gaussians = random_gaussians(np.random.default_rng(1), MANY)
    options = RenderOptions(antialias=antialias, train_focal=200.0, background=(0.1, 0.4, 0.2), threads=2)
    camera = front_camera(width, 70)
    at_once = rasterize(gaussians, camera, options)
    for allowed in (1, SPLAT_BYTES * MANY // 2):  # a part for each tile; a few
        in_parts = rasterize(gaussians, camera, replace(options, memory=allowed))
        assert bits(in_parts) == bits(at_once)
        assert in_parts.pairs == at_once.pairs


def test_more_pairs_than_may_be_listed_are_drawn_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    gaussians = replace(random_gaussians(np.random.default_rng(2), MANY), scales=np.full((MANY, 3), 3.0))
    camera = front_camera(100, 70)
    at_once = rasterize(gaussians, camera, RenderOptions())
    assert at_once.pairs > 30 * MANY
    listed: list[int] = []

    def most(wanted: int, blocks: int, *_: object) -> int:
        listed.append(wanted)
        return 4 * BLOCK * blocks

    monkeypatch.setattr("tsplat.raster.most_pairs", most)
    assert bits(rasterize(gaussians.take(range(MANY)), camera, RenderOptions())) == bits(at_once)
    assert len(listed) > 5


def test_no_more_pairs_are_listed_than_32_bits_can_count() -> None:
    much = RenderOptions(memory=1 << 50)
    assert windows.most_pairs(1 << 40, 1000, much, Buffers()) == windows.MOST_PAIRS < 1 << 31


def test_a_frame_gets_what_it_may_take_and_no_less_than_a_tile_needs() -> None:
    blocks = 100
    fixed = SPLAT_BYTES * BLOCK * blocks
    roomy, narrow = (RenderOptions(memory=fixed + PAIR_BYTES * pairs) for pairs in (10**6, 10))
    assert windows.most_pairs(10**7, blocks, roomy, Buffers()) == 10**6
    assert windows.most_pairs(10**7, blocks, narrow, Buffers()) == BLOCK * blocks
    assert windows.parts_for(blocks, roomy, Buffers()) == 1
    assert windows.parts_for(blocks, RenderOptions(memory=fixed // 3), Buffers()) > 3


def test_a_large_frame_is_held_to_half_of_what_is_free(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(windows, "free_memory", lambda: 4 * windows.SMALL)
    blocks = 10 * windows.SMALL // (SPLAT_BYTES * BLOCK)
    assert windows.parts_for(blocks, RenderOptions(), Buffers()) == 6  # lists of a pair a splat included
    monkeypatch.setattr(windows, "free_memory", lambda: 0)
    assert windows.parts_for(blocks, RenderOptions(), Buffers()) == 11


@pytest.mark.parametrize(("window", "parts"), [((0, 60), 3), ((12, 36), 9), ((24, 36), 5), ((24, 25), 4)])
def test_a_window_is_divided_into_rows_and_a_row_into_tiles(window: tuple[int, int], parts: int) -> None:
    found = windows.divided(Window(*window), parts, columns=12)
    tiles = [tile for part in reversed(found) for tile in range(*part)]
    assert tiles == list(range(*window))
    for part in found:
        one_row = part.first_tile // 12 == (part.end_tile - 1) // 12
        assert one_row or (part.first_tile % 12 == 0 and part.end_tile % 12 == 0)


def test_a_window_covers_its_tiles_of_pixels_and_no_more_than_the_image() -> None:
    assert Window(0, 15).pixels(70, 45) == (0, 0, 69, 44)
    assert Window(5, 10).pixels(70, 45) == (0, 16, 69, 31)
    assert Window(12, 14).pixels(70, 45) == (32, 32, 63, 44)


def test_many_pairs_and_a_small_allowance_stay_within_memory() -> None:
    gaussians = replace(random_gaussians(np.random.default_rng(3), 2000), scales=np.full((2000, 3), 50.0))
    camera = Camera.look_at((0, 0, -4), (0, 0, 0), (0, -1, 0), width=320 if JIT else 32, height=200, fov_y=40.0)
    allowed = 2 * SPLAT_BYTES * 2048
    image = rasterize(gaussians, camera, RenderOptions(memory=allowed))
    assert image.pairs * PAIR_BYTES > allowed or not JIT
    assert (image.alphas > 0.9).all()


@pytest.mark.parametrize("name", memory.VERSIONS)
@pytest.mark.skipif(not Path("/proc/self/cgroup").exists(), reason="there are no control groups")
def test_free_memory_is_the_least_of_what_the_machine_and_the_groups_leave(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str
) -> None:
    version = memory.VERSIONS[name]

    def group(inside: str, most: str, used: int) -> None:
        folder = tmp_path / version.folder / inside
        folder.mkdir(parents=True, exist_ok=True)
        (folder / version.most).write_text(most + "\n")
        (folder / version.used).write_text(f"{used}\n")
        stat = "".join(f"{each} 25\n" for each in version.reclaimable)
        (folder / "memory.stat").write_text(f"anon 5\n{stat}")

    monkeypatch.setattr(memory, "CONTROL_GROUPS", tmp_path)
    here = Path("/proc/self/cgroup").read_text()
    inside = [line.split(":", 2)[2].lstrip("/") for line in here.splitlines() if line.split(":")[1] == name]
    if not inside:
        pytest.skip("this version is not in use here")
    before = memory.free_memory()
    assert 0 < before < memory.UNLIMITED
    group(inside[0], "max", 100)
    assert memory.free_memory() > before // 2
    group("", "1000", 400)
    assert memory.free_memory() == 650
    group(inside[0], "600", 400)
    assert memory.free_memory() == 250
