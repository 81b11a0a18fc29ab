"""How much real scenes shimmer when a view turns slowly, against the supersampled truth: ``shimmer.py``.

A view turns by a tenth of a degree a frame at 240x160. From frame to frame, the high frequencies of the picture,
what its blur by 3x3 pixels takes away, change by some root mean square; printed is how many times the truth's.
Merged is what is drawn within the budget of the viewer. Exits with 1 when `relative` exceeds 1.2.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from functools import partial

import numpy as np
from rich.console import Console
from rich.table import Table

from training import Unsoftened
from tsplat.camera import Pose
from tsplat.lod import Cut, default_budget, hierarchy, rasterize_within
from tsplat.rendering import ANTIALIAS, RenderOptions
from views import F64, FOV_Y, SIZE, Scene, colors, high_frequencies, rms, scenes

FRAMES = 20
TURN = math.radians(0.1)
CLOSER = 0.5
LIMIT = 1.2

Drawing = Callable[[Pose], F64]


def main() -> int:
    """Print a row for each scene, from its start view and from half as far."""
    columns = (*ANTIALIAS, "relative, merged", "not softened")
    table = Table("scene, view", *columns)
    worst = 0.0
    for scene in scenes():
        for view, pose in (("start", scene.pose), ("closer", scene.pose.zoom(CLOSER))):
            truth = shimmer(scene.truth, pose)
            ratios = [shimmer(drawing, pose) / truth for drawing in _drawings(scene)]
            worst = max(worst, *ratios[2:4])
            table.add_row(f"{scene.name}, {view}", *(f"{ratio:.2f}" for ratio in ratios))
    Console(width=100).print(table)
    print(f"relative at most {worst:.2f}, wanted {LIMIT}")
    return int(worst > LIMIT)


def shimmer(drawing: Drawing, pose: Pose) -> float:
    """Return by how much the high frequencies change from frame to frame while the view turns."""
    high = [high_frequencies(drawing(pose.turn(TURN * frame, 0.0))) for frame in range(FRAMES)]
    return rms(np.diff(high, axis=0))


def _drawings(scene: Scene) -> list[Drawing]:
    by_mode = [partial(_draw, scene, scene.options(mode)) for mode in ANTIALIAS]
    unsoftened = Unsoftened(antialias="relative", train_focal=scene.train_focal, depths=False)
    return [*by_mode, _merged(scene), partial(_draw, scene, unsoftened)]


def _draw(scene: Scene, options: RenderOptions, pose: Pose) -> F64:
    return colors(scene.gaussians, pose.camera(*SIZE, FOV_Y), options)


def _merged(scene: Scene) -> Drawing:
    options = scene.options("relative")
    cut = Cut(hierarchy(scene.gaussians, options.worker_count))

    def draw(pose: Pose) -> F64:
        camera = pose.camera(*SIZE, FOV_Y)
        image = rasterize_within(scene.gaussians, camera, options, default_budget(camera), cut)
        return np.clip(image.colors.astype(np.float64), 0.0, 1.0)

    return draw


if __name__ == "__main__":
    sys.exit(main())
