"""Each stage of a frame of the demo, from outside and from inside, on one thread and on all.

A stage is not called by itself: all of them run as one piece, on buffers that they share. Each case draws whole
frames and counts the time that the renderer says the stage took.
"""

from __future__ import annotations

import time

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from tsplat.bench.views import View, camera_path
from tsplat.io import demo_path, load
from tsplat.processors import available_processors
from tsplat.raster import rasterize
from tsplat.raster.frame import STAGES
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians

SIZES = (240, 160), (1280, 720)
VIEWS = "outside 1", "inside 1"
THREADS = tuple(dict.fromkeys((1, available_processors())))
WARM_UP, ROUNDS = 3, 15


class Stopwatch:
    """A clock that stands still except for what is added to it, for use as pytest-benchmark's timer."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def __call__(self) -> float:
        return self.seconds


STOPWATCH = Stopwatch()


@pytest.fixture(scope="module")
def demo() -> Gaussians:
    return load(demo_path())


def view(gaussians: Gaussians, size: tuple[int, int], name: str) -> View:
    return next(view for view in camera_path(gaussians, *size) if view.name == name)


@pytest.mark.parametrize("threads", THREADS, ids="threads={}".format)
@pytest.mark.parametrize("name", VIEWS)
@pytest.mark.parametrize("size", SIZES, ids=lambda size: f"{size[0]}x{size[1]}")
@pytest.mark.parametrize("stage", [*STAGES, "frame"])
@pytest.mark.benchmark(timer=STOPWATCH, disable_gc=True)
def test_stage(
    benchmark: BenchmarkFixture, demo: Gaussians, stage: str, size: tuple[int, int], name: str, threads: int
) -> None:
    camera, options = view(demo, size, name).camera, RenderOptions(threads=threads, depths=False)

    def draw() -> None:
        start = time.perf_counter()
        rendering = rasterize(demo, camera, options)
        whole = time.perf_counter() - start
        STOPWATCH.seconds += whole if stage == "frame" else 1e-3 * rendering.stage_ms[stage]

    benchmark.group = f"{size[0]}x{size[1]}, {name}, {threads} thr."
    benchmark.pedantic(draw, rounds=ROUNDS, warmup_rounds=WARM_UP)  # type: ignore[no-untyped-call]
