"""Ratios against the field's pipeline in C, from outside and inside of real scenes, and whether the floors hold.

    python benchmarks/against_baseline.py [SCENE.ply ...] [--frames N] [--stages]

Both programs take turns of a few frames, on the same view, size and number of threads, and the shortest frame
of each counts: other programs on the machine only ever add to a time. What two threads bring is measured by turns
of our own, with a loop between them that does nothing but compute: processors that others use as well are not two.
Exits with 0 when every floor holds, 1 when one does not, 2 when there is nothing to compare with.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from tsplat._bits import BATCH
from tsplat.camera import F64, Camera
from tsplat.io import load
from tsplat.raster import rasterize
from tsplat.raster.ceilings import blends_per_second
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians

SHARED = Path(__file__).resolve().parents[2] / "shared"
BASELINE = SHARED / "baseline" / "baseline.c"
SCENES = SHARED / "scenes" / "ply"
BUILD = ("gcc", "-O3", "-march=native", "-ffast-math")

FOV_Y = 55.0
TURN = 3
"""Frames of each program before it is the other's turn."""

WARM_UP = 2
"""Frames of each turn that are not counted; the baseline skips as many."""

THREADS = 1, 2
FLOORS = {(240, 160): {1: 3.5, 2: 5.0}, (1280, 720): {1: 6.0, 2: 7.0}}
"""How many times as fast as the baseline each frame must be, by size and threads."""

SCALING_SIZE, SCALING_FLOOR = (1280, 720), 1.8
"""How many times as fast two threads must be as one."""

RATE = 1e8
"""Blends of one thread in a second, roughly: how much is as much work as a frame."""

SCALING_TURNS = 8
"""Turns for what two threads bring, for each of those with the baseline: both processors must be free at once."""

TOTAL = "total"
BELOW = " !"
WIDTH = 120
"""Columns of what is not written to a terminal."""


@dataclass(frozen=True, slots=True)
class View:
    """A place to look from, and the middle of what is seen."""

    name: str
    eye: F64
    target: F64

    def camera(self, width: int, height: int) -> Camera:
        """Return the camera for our renderer; the baseline's image is this one upside down."""
        size = {"width": width, "height": height}
        camera = Camera.look_at(self.eye, self.target, (0.0, 1.0, 0.0), **size, fov_y=FOV_Y)
        K = camera.K.copy()
        K[:2, 2] += 0.5, -0.5  # the baseline has pixel centres on integers
        return Camera(camera.viewmat, K, width, height)


@dataclass(eq=False, slots=True)
class Contest:
    """The shortest times in milliseconds of both programs, by stage, on one view, size and number of threads."""

    threads: int
    baseline: dict[str, float] = field(default_factory=dict)
    ours: dict[str, float] = field(default_factory=dict)


@dataclass(eq=False, slots=True)
class Scaling:
    """The shortest frames in milliseconds, and the most blends a second of the micro-kernel, by threads."""

    ours: dict[int, float] = field(default_factory=dict)
    blends: dict[int, float] = field(default_factory=dict)

    @property
    def machine(self) -> float:
        """How many times as fast two threads were where they only compute: what there is to be had."""
        return self.blends[2] / self.blends[1]


@dataclass(frozen=True, slots=True)
class Verdict:
    """How a frame of ours compares: with what, both in milliseconds, and how many times as fast it must be.

    ``rival`` also says on which size and how many threads: it heads a column of the closing table. ``possible`` is
    the ratio that the machine allows, where that is known.
    """

    view: str
    rival: str
    rival_ms: float
    ours_ms: float
    floor: float
    possible: float | None = None

    @property
    def ratio(self) -> float:
        """How many times as fast as the rival we are."""
        return self.rival_ms / self.ours_ms

    @property
    def holds(self) -> bool:
        """Whether the floor is reached."""
        return self.ratio >= self.floor

    def __str__(self) -> str:
        possible = "" if self.possible is None else f" of {self.possible:.2f}"
        return f"{self.ratio:.2f}{possible}{'' if self.holds else BELOW}"


def views(gaussians: Gaussians) -> tuple[View, View]:
    """Return a view from outside, where the scene fills the frame, and one from inside."""
    means = gaussians.means.astype(np.float64)
    center = np.median(means, axis=0)
    radius = np.percentile(np.linalg.norm(means - center, axis=1), 90)
    outside = View("outside", center + 2.0 * radius * np.array([0.4, 0.3, 0.86]), center)
    eye, target = np.array([0.2, 0.1, 0.3]), np.array([-0.5, 0.05, -1.0])
    return outside, View("inside", center + radius * eye, center + radius * target)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the comparison; return the exit status."""
    parser = argparse.ArgumentParser(description="Compare tsplat with the baseline, frame by frame.")
    parser.add_argument("scene", nargs="*", type=Path, help=f"float32 PLY files [{SCENES}/*.ply]")
    parser.add_argument("--baseline", type=Path, default=BASELINE, help="its source [%(default)s]")
    parser.add_argument(
        "--frames", type=int, default=27, help="least number of frames of each program [%(default)s]"
    )
    parser.add_argument("--stages", action="store_true", help="print the shortest time of each stage as well")
    chosen = parser.parse_args(arguments)
    scenes = chosen.scene or sorted(SCENES.glob("*.ply"))
    for path in (chosen.baseline, *(scenes or [SCENES / "*.ply"])):
        if not path.is_file():
            return _nothing(f"looked for {path}, which is not there; see --help for other places")
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "baseline"
        try:
            subprocess.run([*BUILD, "-o", program, chosen.baseline, "-lm", "-lpthread"], check=True)
        except (OSError, subprocess.CalledProcessError) as error:
            return _nothing(f"looked for a gcc that builds {chosen.baseline}; {error}")
        turns = -(-max(1, chosen.frames) // TURN)
        found = [each for scene in scenes for each in compare(program, scene, turns, chosen.stages)]
    return conclude(found)


def compare(program: Path, scene: Path, turns: int, stages: bool) -> Iterator[Verdict]:
    """Print the times of a scene, a view and a size at a time; yield what they say of the floors."""
    gaussians = load(scene)
    for view in views(gaussians):
        for size in FLOORS:
            contests = contest(program, scene, gaussians, view, size, turns)
            scaling = scale(gaussians, view.camera(*size), turns) if size == SCALING_SIZE else None
            for each in verdicts(f"{scene.stem} {view.name}", size, contests, scaling):
                times = f"{each.ours_ms:8.2f} ms against {each.rival_ms:8.2f} ms"
                print(f"{each.view:35} {each.rival:22} {times}  {each}", flush=True)
                yield each
            if stages:
                _print_stages(contests)


def contest(
    program: Path, scene: Path, gaussians: Gaussians, view: View, size: tuple[int, int], turns: int
) -> list[Contest]:
    """Let both programs draw a view in turns, on each number of threads."""
    contests = [Contest(threads) for threads in THREADS]
    camera = view.camera(*size)
    for _ in range(turns):
        for each in contests:
            _keep_least(each.baseline, _draw_baseline(program, scene, view, size, each.threads))
            for frame, times in enumerate(_draw_ours(gaussians, camera, each.threads)):
                if frame >= WARM_UP:
                    _keep_least(each.ours, times)
    return contests


def scale(gaussians: Gaussians, camera: Camera, turns: int) -> Scaling:
    """Draw a view on one thread and on two in turns, with as long a computation in between."""
    scaling = Scaling()
    for _ in range(SCALING_TURNS * turns):
        for threads in THREADS:
            frames = [times[TOTAL] for times in _draw_ours(gaussians, camera, threads)]
            scaling.ours[threads] = min(scaling.ours.get(threads, math.inf), *frames[WARM_UP:])
            rounds = round(1e-3 * scaling.ours[threads] * RATE / BATCH)
            blends = blends_per_second(threads, rounds, repeats=1)
            scaling.blends[threads] = max(blends, scaling.blends.get(threads, 0.0))
    return scaling


def verdicts(
    view: str, size: tuple[int, int], contests: Sequence[Contest], scaling: Scaling | None
) -> list[Verdict]:
    """Return what the times say of every floor for this size."""
    column, found = f"{size[0]}x{size[1]}", []
    for each in contests:
        floor = FLOORS[size][each.threads]
        found.append(Verdict(view, f"{column} {each.threads} thr.", each.baseline[TOTAL], each.ours[TOTAL], floor))
    if scaling:
        one, two = (scaling.ours[threads] for threads in THREADS)
        found.append(Verdict(view, f"{column} 2 to 1 thr.", one, two, SCALING_FLOOR, scaling.machine))
    return found


def conclude(found: Sequence[Verdict]) -> int:
    """Print the table of ratios; return the exit status."""
    floors = {each.rival: each.floor for each in found}
    table = Table("times as fast", *floors, header_style="cyan", title="against the baseline, and 2 threads to 1")
    table.add_row("floor", *(f"{floor:.2f}" for floor in floors.values()), end_section=True)
    for view in dict.fromkeys(each.view for each in found):
        ratios = {each.rival: str(each) for each in found if each.view == view}
        table.add_row(view, *(ratios.get(rival, "") for rival in floors))
    Console(width=None if sys.stdout.isatty() else WIDTH, highlight=False).print("", table)
    missed = sum(not each.holds for each in found)
    print(
        f"{len(found) - missed} of {len(found)} floors hold"
        + (f"; {BELOW.strip()} marks the others" if missed else "")
    )
    return 1 if missed else 0


def _draw_baseline(
    program: Path, scene: Path, view: View, size: tuple[int, int], threads: int
) -> dict[str, float]:
    numbers = (*size, FOV_Y, threads, TURN, "-", *view.eye, *view.target)
    done = subprocess.run([program, scene, *map(str, numbers)], capture_output=True, check=True)
    return {
        name.removesuffix("_ms"): each["min"] for name, each in json.loads(done.stdout).items() if "_ms" in name
    }


def _draw_ours(gaussians: Gaussians, camera: Camera, threads: int) -> Iterator[dict[str, float]]:
    options = RenderOptions(threads=threads, depths=False)
    for _ in range(WARM_UP + TURN):
        start = time.perf_counter()
        rendering = rasterize(gaussians, camera, options)
        yield {**rendering.stage_ms, TOTAL: 1e3 * (time.perf_counter() - start)}


def _keep_least(least: dict[str, float], times: dict[str, float]) -> None:
    for stage, milliseconds in times.items():
        least[stage] = min(milliseconds, least.get(stage, milliseconds))


def _print_stages(contests: Sequence[Contest]) -> None:
    for each in contests:
        for name, times in (("tsplat", each.ours), ("baseline", each.baseline)):
            stages = "  ".join(f"{stage} {time:.2f}" for stage, time in times.items() if stage != TOTAL)
            print(f"    {each.threads} thr. {name:>8} ms: {stages}", flush=True)


def _nothing(text: str) -> int:
    print(f"against_baseline: {text}", file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
