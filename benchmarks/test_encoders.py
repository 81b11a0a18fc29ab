"""Each encoder on a frame of the demo: what a viewer does between drawing and writing."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from tsplat.bench.views import camera_path
from tsplat.encode import ENCODERS, FALLBACK_CELL, encoder
from tsplat.encode.iterm2 import ITerm2
from tsplat.encode.kitty import TRANSPORTS, Kitty
from tsplat.encode.protocol import U8
from tsplat.encode.sixel import Sixel
from tsplat.io import demo_path, load
from tsplat.raster import rasterize
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians

CELLS = (80, 24), (240, 67)
"""Columns and rows of a small and of a large terminal."""

TEXT = [(name, colors) for colors in (1 << 24, 256, 16, 0) for name in ENCODERS[ENCODERS.index("octant") :]]
TEXT_CELLS = 200, 60
"""Cells, all of which change in every frame."""


@pytest.fixture(scope="module")
def demo() -> Gaussians:
    return load(demo_path())


def frame(gaussians: Gaussians, width: int, height: int) -> U8:
    camera = camera_path(gaussians, width, height)[0].camera
    return rasterize(gaussians, camera, RenderOptions(depths=False)).frame()


FIDELITIES = 1.0, 0.8, 0.6, 0.4, 0.2
"""What a viewer asks for while it moves, from all to little."""


@pytest.mark.parametrize("cells", CELLS, ids=lambda cells: f"{cells[0]}x{cells[1]}")
@pytest.mark.parametrize("name", ["kitty", "sixel"])
def test_encoder(benchmark: BenchmarkFixture, demo: Gaussians, name: str, cells: tuple[int, int]) -> None:
    columns, rows = cells
    encode = encoder(name)
    across, down = encode.pixels_per_cell(*FALLBACK_CELL)
    picture = frame(demo, columns * across, rows * down)
    encode.encode(picture, columns, rows, FALLBACK_CELL)  # compiles
    benchmark.group = f"encode {columns} x {rows} cells"
    encoded = benchmark(encode.encode, picture, columns, rows, FALLBACK_CELL)
    benchmark.extra_info["bytes"] = len(encoded.upload) + len(encoded.draw)


@pytest.mark.parametrize("fidelity", [1.0, 0.5])
@pytest.mark.parametrize(("name", "colors"), TEXT)
def test_cells(benchmark: BenchmarkFixture, demo: Gaussians, name: str, colors: int, fidelity: float) -> None:
    columns, rows = TEXT_CELLS
    encode = encoder(name, colors)
    across, down = encode.pixels_per_cell(*FALLBACK_CELL)
    noise = np.random.default_rng(1).integers(0, 64, (rows * down, columns * across, 3), dtype=np.uint8)
    picture = frame(demo, columns * across, rows * down) // 2 + noise
    pictures = itertools.cycle([picture, picture[::-1].copy()])
    encode.encode(next(pictures), columns, rows, FALLBACK_CELL)  # compiles
    encode.fidelity = fidelity
    benchmark.group = f"encode {columns} x {rows} cells, {colors} colours, fidelity {fidelity}"
    encoded = benchmark(lambda: encode.encode(next(pictures), columns, rows, FALLBACK_CELL))
    benchmark.extra_info["bytes"] = len(encoded.draw)


@pytest.mark.parametrize("name", ["octant", "half", "ascii"])
def test_cells_at_rest(benchmark: BenchmarkFixture, demo: Gaussians, name: str) -> None:
    columns, rows = TEXT_CELLS
    encode = encoder(name)
    across, down = encode.pixels_per_cell(*FALLBACK_CELL)
    picture = frame(demo, columns * across, rows * down)
    encode.encode(picture, columns, rows, FALLBACK_CELL)
    benchmark.group = f"encode {columns} x {rows} cells at rest"
    assert benchmark(encode.encode, picture, columns, rows, FALLBACK_CELL).draw == b""


@pytest.mark.parametrize("fidelity", FIDELITIES)
@pytest.mark.parametrize("make", [Kitty, Sixel, ITerm2], ids=["kitty", "sixel", "iterm2"])
def test_picture_fidelity(
    benchmark: BenchmarkFixture, demo: Gaussians, make: Callable[[], Kitty | Sixel | ITerm2], fidelity: float
) -> None:
    encode = make()
    encode.fidelity = fidelity
    picture = frame(demo, 800, 480)
    encode.encode(picture, 80, 24, FALLBACK_CELL)  # compiles, and makes the palette
    benchmark.group = f"{encode.name} at 800 x 480, by fidelity"
    encoded = benchmark(encode.encode, picture, 80, 24, FALLBACK_CELL)
    benchmark.extra_info["bytes"] = len(encoded.upload) + len(encoded.draw)


@pytest.mark.parametrize("tmux", [False, True], ids=["bare", "tmux"])
@pytest.mark.parametrize("transport", TRANSPORTS)
def test_kitty_transport(benchmark: BenchmarkFixture, demo: Gaussians, transport: str, tmux: bool) -> None:
    encode = Kitty(transport, tmux)
    picture = frame(demo, 800, 480)
    benchmark.group = "kitty at 800 x 480, by transport"
    try:
        benchmark(encode.encode, picture, 80, 24, FALLBACK_CELL)
    finally:
        encode.clear()


def test_dithered_sixel(benchmark: BenchmarkFixture, demo: Gaussians) -> None:
    encode = Sixel(dither=True)
    picture = frame(demo, 800, 480)
    encode.encode(picture, 80, 24, FALLBACK_CELL)
    benchmark.group = "sixel at 800 x 480, dithered"
    encoded = benchmark(encode.encode, picture, 80, 24, FALLBACK_CELL)
    benchmark.extra_info["bytes"] = len(encoded.upload) + len(encoded.draw)
