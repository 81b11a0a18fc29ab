"""Each encoder on a frame of the demo: what a viewer does between drawing and writing."""

from __future__ import annotations

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from tsplat.bench.views import camera_path
from tsplat.encode import FALLBACK_CELL, encoder
from tsplat.encode.protocol import U8
from tsplat.io import demo_path, load
from tsplat.raster import rasterize
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians

CELLS = (80, 24), (240, 67)
"""Columns and rows of a small and of a large terminal."""


@pytest.fixture(scope="module")
def demo() -> Gaussians:
    return load(demo_path())


def frame(gaussians: Gaussians, width: int, height: int) -> U8:
    camera = camera_path(gaussians, width, height)[0].camera
    return rasterize(gaussians, camera, RenderOptions(depths=False)).frame()


@pytest.mark.parametrize("cells", CELLS, ids=lambda cells: f"{cells[0]}x{cells[1]}")
@pytest.mark.parametrize("name", ["half", "half256", "kitty", "sixel"])
def test_encoder(benchmark: BenchmarkFixture, demo: Gaussians, name: str, cells: tuple[int, int]) -> None:
    columns, rows = cells
    encode = encoder(name)
    across, down = encode.pixels_per_cell(*FALLBACK_CELL)
    picture = frame(demo, columns * across, rows * down)
    encode.encode(picture, columns, rows, FALLBACK_CELL)  # compiles
    benchmark.group = f"encode {columns} x {rows} cells"
    encoded = benchmark(encode.encode, picture, columns, rows, FALLBACK_CELL)
    benchmark.extra_info["bytes"] = len(encoded.upload) + len(encoded.draw)
