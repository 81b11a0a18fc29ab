"""What levels of detail cost and keep: frame times of a growing scene, closeness to the truth, pops, building.

    python benchmarks/levels_of_detail.py [SCENE ...] [--copies N] [--frames N] [--baseline FILE.c]

The truth is the whole scene rendered at four times the size and box-filtered. A scene grows by copies of itself,
side by side. Exits with 0 when all floors hold, 1 when one does not, 2 when there is no scene.
"""

from __future__ import annotations

import argparse
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.table import Table

from against_baseline import BASELINE, BUILD, SCENES, TOTAL, View, _draw_baseline, views
from tsplat.camera import Camera
from tsplat.io import load
from tsplat.lod import Cut, default_budget, hierarchy, rasterize_within
from tsplat.lod.hierarchy import build
from tsplat.raster import rasterize
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians

F32 = npt.NDArray[np.float32]

SMALL, LARGE = (240, 160), (1280, 720)
TIMES_LARGER = 4
"""Than a frame is what the truth is filtered from; the scenes count as trained at that size."""

TURN_FRAMES = 180
"""Of a whole circle, two degrees each."""

GROWTH = (100_000, 5_500_000)
"""Splats from which and to which a scene grows."""


@dataclass(frozen=True, slots=True)
class Figure:
    """What was measured, and what was asked: at least, or at most where ``most``."""

    name: str
    value: float
    asked: float
    unit: str
    most: bool = False

    @property
    def holds(self) -> bool:
        """Whether it is what was asked."""
        return self.value <= self.asked if self.most else self.value >= self.asked


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure; return the exit status."""
    parser = argparse.ArgumentParser(description="Measure levels of detail.")
    parser.add_argument("scene", nargs="*", type=Path, help=f"scenes [{SCENES}/*.ply]")
    parser.add_argument("--baseline", type=Path, default=BASELINE, help="its source [%(default)s]")
    parser.add_argument("--frames", type=int, default=30, help="frames of each timing [%(default)s]")
    chosen = parser.parse_args(arguments)
    scenes = chosen.scene or sorted(SCENES.glob("*.ply"))
    if not scenes or not all(path.is_file() for path in scenes):
        print("levels_of_detail: no scene; give the path of one", file=sys.stderr)
        return 2
    figures: list[Figure] = []
    for figure in measure(scenes, chosen.baseline, chosen.frames):
        figures.append(figure)
        mark = "" if figure.holds else "  !"
        print(f"{figure.name:70} {figure.value:9.2f} {figure.unit}{mark}", flush=True)
    table = Table("what", "asked", "measured", header_style="cyan", title="levels of detail, two threads")
    for each in figures:
        sign = "<=" if each.most else ">="
        table.add_row(
            each.name, f"{sign} {each.asked:g} {each.unit}", f"{each.value:.2f}{'' if each.holds else ' !'}"
        )
    Console(width=None if sys.stdout.isatty() else 120, highlight=False).print("", table)
    return 0 if all(each.holds for each in figures) else 1


def measure(scenes: Sequence[Path], baseline: Path, frames: int) -> Iterator[Figure]:
    """Yield all figures."""
    largest = max((load(path) for path in scenes), key=len)
    yield from growth(largest, frames)
    for path in scenes:
        gaussians = load(path)
        for view in views(gaussians):
            yield from closeness(f"{path.stem} {view.name}", gaussians, view)
        yield from pops(path.stem, gaussians)
        if baseline.is_file() and len(gaussians) >= 500_000:
            yield from against_all(path, gaussians, baseline, frames)


def growth(gaussians: Gaussians, frames: int) -> Iterator[Figure]:
    """Time moving frames of a scene that grows."""
    least, most = GROWTH
    few = gaussians.take(np.random.default_rng(0).permutation(len(gaussians))[:least])
    many = copies(gaussians, math.ceil(most / len(gaussians)))
    begun = time.perf_counter()
    build(many, 2, lambda _: None)
    seconds = time.perf_counter() - begun
    yield Figure(
        f"building, {len(many) / 1e6:.1f}M splats", seconds * 1e6 / len(many), 3.0, "s a million", most=True
    )
    times = {(name, size): moving_frame(scene, size, frames)
             for name, scene in (("few", few), ("many", many)) for size in (SMALL, LARGE)}  # fmt: skip
    grown = times["many", SMALL] / times["few", SMALL]
    yield Figure(
        f"240x160, {len(many) / 1e6:.1f}M against {len(few) / 1e6:.1f}M splats", grown, 1.8, "times", most=True
    )
    for size, asked in ((SMALL, 40.0), (LARGE, 12.0)):
        name = f"{size[0]}x{size[1]}, {len(many) / 1e6:.1f}M splats, moving"
        yield Figure(name, 1e3 / times["many", size], asked, "frames a second")


def closeness(name: str, gaussians: Gaussians, view: View) -> Iterator[Figure]:
    """Compare a frame within the budget, and one of all splats, with the truth."""
    camera = view.camera(*SMALL)
    options, true = relative(camera), truth(gaussians, view)
    whole = psnr(rasterize(gaussians, camera, options).colors, true)
    within = psnr(rasterize_within(gaussians, camera, options, default_budget(camera)).colors, true)
    yield Figure(f"{name}: lost of {whole:.1f} dB within the budget", whole - within, 1.5, "dB", most=True)


def pops(name: str, gaussians: Gaussians) -> Iterator[Figure]:
    """Turn the camera through a whole circle around the scene."""
    outside = views(gaussians)[0]
    cut = Cut(hierarchy(gaussians, 2))
    before: tuple[F32, F32] | None = None
    worst = 0.0
    for frame in range(TURN_FRAMES):
        camera = turned(outside, 2.0 * math.pi * frame / TURN_FRAMES).camera(*SMALL)
        options, budget = relative(camera), default_budget(camera)
        now = (
            rasterize_within(gaussians, camera, options, budget, cut).colors.copy(),
            rasterize(gaussians, camera, options).colors.copy(),
        )
        if before is not None:
            merged, whole = (np.abs(a - b) for a, b in zip(now, before, strict=True))
            worst = max(worst, 255.0 * float(np.maximum(merged - whole, 0.0).mean()))
        before = now
    yield Figure(f"{name}: most that a frame changes beyond the whole scene", worst, 1.5, "of 255", most=True)


def against_all(path: Path, gaussians: Gaussians, source: Path, frames: int) -> Iterator[Figure]:
    """Race a moving frame against the baseline drawing all splats, and see which is nearer the truth."""
    view = views(gaussians)[0]
    camera = view.camera(*SMALL)
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "baseline"
        subprocess.run([*BUILD, "-o", program, source, "-lm", "-lpthread"], check=True)
        theirs, ours = math.inf, math.inf
        for _ in range(3):
            theirs = min(theirs, _draw_baseline(program, path, view, SMALL, 2)[TOTAL])
            ours = min(ours, moving_frame(gaussians, SMALL, frames))
    yield Figure(f"{path.stem}: frame against the baseline drawing all", theirs / ours, 12.0, "times as fast")
    true = truth(gaussians, view)
    classic = psnr(rasterize(gaussians, camera, RenderOptions(depths=False)).colors, true)
    merged = psnr(rasterize_within(gaussians, camera, relative(camera), default_budget(camera)).colors, true)
    yield Figure(
        f"{path.stem}: nearer the truth than the baseline's {classic:.1f} dB", merged - classic, 5.0, "dB"
    )


def moving_frame(gaussians: Gaussians, size: tuple[int, int], frames: int) -> float:
    """Return the milliseconds of the quickest frame of a slow turn."""
    outside, cut = views(gaussians)[0], Cut(hierarchy(gaussians, 2))
    best = math.inf
    for frame in range(frames):
        camera = turned(outside, 0.02 * frame).camera(*size)
        options = relative(camera)
        start = time.perf_counter()
        rasterize_within(gaussians, camera, options, default_budget(camera), cut)
        best = min(best, time.perf_counter() - start)
    return 1e3 * best


def relative(camera: Camera) -> RenderOptions:
    """Return the options for a frame of a scene that was trained at the size the truth is filtered from."""
    focal = TIMES_LARGER * math.sqrt(float(camera.K[0, 0] * camera.K[1, 1]))
    return RenderOptions(antialias="relative", train_focal=focal, depths=False, threads=2)


def truth(gaussians: Gaussians, view: View) -> F32:
    """Return the scene as seen by pixels that take in all of their area."""
    width, height = SMALL
    K = view.camera(width, height).K.copy()
    K[:2] *= TIMES_LARGER
    size = width * TIMES_LARGER, height * TIMES_LARGER
    large = rasterize(gaussians, Camera(view.camera(width, height).viewmat, K, *size), RenderOptions(depths=False))
    pixels = np.clip(large.colors, 0, 1).reshape(height, TIMES_LARGER, width, TIMES_LARGER, 3)
    filtered: F32 = pixels.mean((1, 3))
    return filtered


def turned(view: View, angle: float) -> View:
    """Return a view turned about the upright through its target."""
    sine, cosine = math.sin(angle), math.cos(angle)
    x, y, z = view.eye - view.target
    return View(view.name, view.target + np.array([cosine * x + sine * z, y, cosine * z - sine * x]), view.target)


def copies(gaussians: Gaussians, count: int) -> Gaussians:
    """Return so many copies of a scene side by side, in a square."""
    low, high = np.percentile(gaussians.means, (1, 99), axis=0)
    side = math.ceil(math.sqrt(count))
    places = [(i % side, 0, i // side) for i in range(count)]
    means = [gaussians.means + (np.array(place) * 1.1 * (high - low)).astype(np.float32) for place in places]
    quats, scales, opacities, sh = (np.concatenate([array] * count) for array in gaussians.arrays[1:])
    return Gaussians(np.concatenate(means), quats, scales, opacities, sh)


def psnr(image: F32, true: F32) -> float:
    """Return the peak signal-to-noise ratio in dB for a peak of 1."""
    return -10.0 * math.log10(float(np.mean((np.clip(image, 0, 1) - np.clip(true, 0, 1)) ** 2)) + 1e-12)


if __name__ == "__main__":
    sys.exit(main())
