"""What the levels of a streamed SOG are worth within a budget, and how soon they are there.

    python benchmarks/streamed.py [SCENE ...] [--leaves N] [--levels N]

A lod-meta.json is taken as it is; any other scene is cut into leaves by a kd tree, with levels of half as many
splats each by `tsplat.lod.decimate`. Compared with the truth, as in levels_of_detail.py, are the whole scene, our
own levels built of it, the finest level that fits the budget everywhere, and the levels leaf by leaf. Then the
seconds that opening takes: the coarsest levels, all of them, and the finest one alone.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from against_baseline import SCENES, View, views
from levels_of_detail import SMALL, psnr, relative, truth, turned
from tsplat import io
from tsplat.io.sog_levels import open_levels
from tsplat.lod import (
    Streamed,
    decimate,
    default_budget,
    open_streamed,
    rasterize_all,
    rasterize_within,
    read_levels,
)
from tsplat.raster import rasterize
from tsplat.rendering import Rendering
from tsplat.scene import Gaussians

LEVELS_MADE, LEAVES_MADE = 5, 48

ROUNDS = 3


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure; return the exit status."""
    parser = argparse.ArgumentParser(description="Measure streamed SOGs.")
    parser.add_argument("scene", nargs="*", type=Path, help=f"scenes [{SCENES}/*.ply]")
    parser.add_argument("--leaves", type=int, default=LEAVES_MADE, help="of scenes that are cut [%(default)s]")
    parser.add_argument("--levels", type=int, default=LEVELS_MADE, help="of scenes that are cut [%(default)s]")
    chosen = parser.parse_args(arguments)
    scenes = chosen.scene or sorted(SCENES.glob("*.ply"))
    if not scenes or not all(path.is_file() for path in scenes):
        print("streamed: no scene; give the path of one", file=sys.stderr)
        return 2
    for path in scenes:
        with tempfile.TemporaryDirectory() as folder:
            streamed = (
                path if path.suffix == ".json" else cut(io.load(path), Path(folder), chosen.leaves, chosen.levels)
            )
            compare(streamed)
            opening(streamed)
    return 0


def compare(path: Path) -> None:
    """Print how close to the truth the same budgets come."""
    streamed, finest, levels = open_streamed(path), io.load(path), coarser_levels(path)
    outside, inside = views(finest)
    print(f"{path}: {len(levels)} levels of {', '.join(str(len(level)) for level in levels)} splats")
    print(f"{'dB (splats)':24}{'whole':>18}{'our levels':>18}{'one level':>18}{'leaf by leaf':>18}")
    for name, view in {"outside": outside, "turned": turned(outside, 2.1), "inside": inside}.items():
        for share in (1, 4):
            measured = within(streamed, finest, levels, view, share)
            print(
                f"{name + f', a {share}th' * (share > 1):24}" + "".join(f"{each:>18}" for each in measured),
                flush=True,
            )


def within(
    streamed: Streamed, finest: Gaussians, levels: list[Gaussians], view: View, share: int
) -> Iterator[str]:
    """Yield the closeness of each way, and how many splats it drew."""
    camera, true = view.camera(*SMALL), truth(finest, view)
    options, budget = relative(camera), default_budget(camera) // share
    drawings: list[Callable[[], Rendering]] = [
        lambda: rasterize(finest, camera, options),
        lambda: rasterize_within(finest, camera, options, budget),
        lambda: uniform(levels, lambda level: rasterize(level, camera, options), budget),
        lambda: rasterize_within(streamed, camera, options, budget),
    ]
    for draw in drawings:
        drawn = draw()
        yield f"{psnr(drawn.colors, true):.1f} ({drawn.visible})"
    whole = rasterize(finest, camera, options).colors.copy()
    assert np.array_equal(rasterize_all(streamed, camera, options).colors, whole)


def uniform(levels: list[Gaussians], draw: Callable[[Gaussians], Rendering], budget: int) -> Rendering:
    """Draw the finest level of which no more are visible, or the coarsest."""
    return next((drawn for level in levels if (drawn := draw(level)).visible <= budget), draw(levels[-1]))


def coarser_levels(path: Path) -> list[Gaussians]:
    """Return all levels, the finest first."""
    count = json.loads(path.read_text())["lodLevels"]
    return [io.load(path, lod=level) for level in range(count)]


def opening(path: Path) -> None:
    """Print how long it takes."""
    ways: dict[str, Callable[[], object]] = {
        "coarsest levels": lambda: read_levels(open_levels(path), whole=False, progress=lambda _: None),
        "all levels": lambda: open_streamed(path),
        "finest level alone": lambda: io.load(path),
    }
    for name, read in ways.items():
        least = math.inf
        for _ in range(ROUNDS):
            begun = time.perf_counter()
            read()
            least = min(least, time.perf_counter() - begun)
        print(f"{name:24}{least:8.2f} s", flush=True)


def cut(gaussians: Gaussians, folder: Path, leaves: int, levels: int) -> Path:
    """Write a scene as a streamed one, a file for each leaf on each level; return its lod-meta.json."""
    lods: list[dict[str, dict[str, int]]] = [{} for _ in range(leaves)]
    names: list[str] = []
    scenes = [gaussians, *(decimate(gaussians, len(gaussians) >> level) for level in range(1, levels))]
    for level, scene in enumerate(scenes):
        for leaf, rows in enumerate(cells([each.means for each in scenes], leaves)[level]):
            if len(rows):
                lods[leaf][str(level)] = {"file": len(names), "offset": 0, "count": len(rows)}
                names.append(f"{level}_{leaf}.sog")
                io.save(folder / names[-1], scene.take(rows))
    path = folder / "lod-meta.json"
    tree = {"children": [{"lods": each} for each in lods]}
    path.write_text(json.dumps({"lodLevels": levels, "filenames": names, "tree": tree}))
    return path


def cells(
    means: list[npt.NDArray[np.float32]], count: int, rows: list[npt.NDArray[np.int64]] | None = None
) -> list[list[npt.NDArray[np.int64]]]:
    """Return which splats of each level lie in each cell, cut where half of the finest level is on either side."""
    rows = rows or [np.arange(len(each)) for each in means]
    if count == 1:
        return [[each] for each in rows]
    inside = means[0][rows[0]]
    axis = int(np.argmax(np.ptp(inside, axis=0)))
    middle = np.median(inside[:, axis])
    left = [each[level[each, axis] <= middle] for level, each in zip(means, rows, strict=True)]
    right = [each[level[each, axis] > middle] for level, each in zip(means, rows, strict=True)]
    halves = cells(means, count // 2, left), cells(means, count - count // 2, right)
    return [first + second for first, second in zip(*halves, strict=True)]


if __name__ == "__main__":
    sys.exit(main())
