"""Real SOG scenes against the PLY of the same scene: number by number, and as pictures."""

from __future__ import annotations

import numpy as np
import pytest

from tests.raster.compare import psnr
from tests.scenes import shared_scenes
from tsplat import io
from tsplat._jit import JIT
from tsplat.framing import start_pose
from tsplat.raster import rasterize
from tsplat.rendering import RenderOptions

SCENES = shared_scenes()
NO_SCENES = "no folder of real scenes: set TSPLAT_SCENES or have ../shared/scenes"


def nearest(points: np.ndarray, others: np.ndarray) -> np.ndarray:
    parts = [points[first : first + 256] for first in range(0, len(points), 256)]
    return np.concatenate([((part[:, None] - others) ** 2).sum(axis=2).argmin(axis=1) for part in parts])


@pytest.mark.skipif(SCENES is None, reason=NO_SCENES)
@pytest.mark.parametrize(("name", "sh_degree"), [("yashica", 3), ("playbot31k", 2)])
def test_a_real_scene_agrees_with_its_ply(name: str, sh_degree: int) -> None:
    assert SCENES is not None
    before = io.load(SCENES / "format_matrix" / f"{name}.ply")
    after = io.load(SCENES / "format_matrix" / f"{name}.sog")
    assert (len(after), after.sh_degree) == (len(before), sh_degree)
    step = np.ptp(np.sign(before.means) * np.log1p(np.abs(before.means)), axis=0) / 65535
    before = before.take(range(0, len(before), len(before) // 2000))
    after = after.take(order := nearest(before.means, after.means))
    assert len(np.unique(order)) == len(before), "each splat is found once"
    logs = [np.sign(each.means) * np.log1p(np.abs(each.means)) for each in (before, after)]
    # A step of 16 bits; a byte of each quat component; codebooks and the palette are fitted, so shares of them.
    assert np.all(np.abs(logs[0] - logs[1]) <= 1.01 * step + 1e-6)
    angles = 2 * np.degrees(np.arccos(np.minimum(1.0, np.abs(np.sum(before.quats * after.quats, axis=1)))))
    assert angles.max() < 2.2
    assert np.abs(before.opacities - after.opacities).max() < 1.01 / 255
    assert np.quantile(np.abs(np.log(before.scales / after.scales)), 0.99) < 0.04
    off = np.abs(before.sh - after.sh)
    assert np.quantile(off[:, 0], 0.99) < 0.02
    assert np.quantile(off[:, 1:], 0.99) < 0.1
    assert np.mean(off[:, 1:]) < 0.1 * np.mean(np.abs(before.sh[:, 1:]))


@pytest.mark.skipif(not JIT, reason="thousands of splats take minutes without a compiler")
@pytest.mark.skipif(SCENES is None, reason=NO_SCENES)
@pytest.mark.parametrize(("name", "floor"), [("yashica", 36.0), ("playbot31k", 50.0)])
def test_a_real_scene_looks_like_its_ply(name: str, floor: float) -> None:
    assert SCENES is not None
    before, after = (io.load(SCENES / "format_matrix" / f"{name}.{suffix}") for suffix in ("ply", "sog"))
    camera = start_pose(before, aspect=16 / 9, fov_y=50.0).camera(320, 180, 50.0)
    images = [rasterize(each, camera, RenderOptions()).colors for each in (before, after)]
    assert images[0].std() > 0.05
    assert psnr(images[1], images[0]) >= floor
