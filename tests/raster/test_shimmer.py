"""What the eye follows: small pictures of a slowly turning view change as those of a finer one do."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from tests.scenes import shared_scenes
from tsplat._jit import JIT
from tsplat.framing import start_pose
from tsplat.io import demo_path, load
from tsplat.lod import Cut, default_budget, hierarchy, rasterize_within
from tsplat.raster import rasterize
from tsplat.rendering import Rendering, RenderOptions

FINER = 4
FRAMES = 6
FOLDER = shared_scenes()
SCENES: list[tuple[Path, float | None]] = [(demo_path(), None)]
if FOLDER:
    SCENES += [
        (FOLDER / "ply" / "plant.ply", None),
        (FOLDER / "snowmiku" / "trained" / "snow_sh3_3000.ply", 205.3),
    ]

F64 = npt.NDArray[np.float64]


def high_frequencies(image: F64) -> F64:
    """Return an image minus the mean of each pixel's nine, the rim left out."""
    height, width = image.shape[:2]
    nine = [image[y : height - 2 + y, x : width - 2 + x] for y in range(3) for x in range(3)]
    high: F64 = image[1:-1, 1:-1] - np.mean(nine, axis=0)
    return high


def shimmer(frames: list[F64]) -> float:
    changes = np.diff([high_frequencies(frame) for frame in frames], axis=0)
    return math.sqrt(float(np.mean(changes**2)))


def _colors(rendering: Rendering) -> F64:
    return np.clip(rendering.colors.astype(np.float64), 0.0, 1.0)


@pytest.mark.skipif(not JIT, reason="hundreds of thousands of splats take hours without a compiler")
@pytest.mark.parametrize(("path", "train_focal"), SCENES, ids=lambda value: getattr(value, "stem", ""))
def test_relative_shimmers_hardly_more_than_the_supersampled_truth(path: Path, train_focal: float | None) -> None:
    scene = load(path)
    pose = start_pose(scene, aspect=1.5, fov_y=55.0)
    small, large = (
        [pose.turn(math.radians(0.1 * frame), 0.0).camera(size * 240, size * 160, 55.0) for frame in range(FRAMES)]
        for size in (1, FINER)
    )
    options = RenderOptions(antialias="relative", train_focal=train_focal or float(large[0].K[0, 0]), depths=False)
    fine = [_colors(rasterize(scene, camera, options)) for camera in large]
    truth = shimmer([each.reshape(160, FINER, 240, FINER, 3).mean(axis=(1, 3)) for each in fine])
    assert shimmer([_colors(rasterize(scene, camera, options)) for camera in small]) < 1.2 * truth
    cut, budget = Cut(hierarchy(scene, options.worker_count)), default_budget(small[0])
    merged = [_colors(rasterize_within(scene, camera, options, budget, cut)) for camera in small]
    assert shimmer(merged) < 1.2 * truth
