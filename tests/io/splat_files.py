"""Scenes beside their PLY twins for the tests of ``.splat`` and ``.ksplat``."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from tests.raster.compare import psnr
from tests.scenes import shared_scenes
from tsplat.framing import start_pose
from tsplat.raster import rasterize
from tsplat.rendering import RenderOptions
from tsplat.scene import SH_C0, Gaussians

SCENES = shared_scenes()

needs_scenes = pytest.mark.skipif(
    SCENES is None, reason="no folder of real scenes: set TSPLAT_SCENES or have ../shared/scenes"
)


def in_bytes(gaussians: Gaussians, sh_degree: int) -> Gaussians:
    """Return the scene as bytes can hold it: colours without view inside 0 to 1, nothing above ``sh_degree``."""
    sh = gaussians.sh[:, : (sh_degree + 1) ** 2].copy()
    half = 0.5 / SH_C0
    sh[:, 0] = np.clip(sh[:, 0], -half, half)
    return Gaussians(gaussians.means, gaussians.quats, gaussians.scales, gaussians.opacities, sh)


def apart(quats: npt.NDArray[np.float32], others: npt.NDArray[np.float32]) -> float:
    """Return the largest angle in radians between rotations; a quat and its negative are the same."""
    short = np.minimum(np.linalg.norm(quats - others, axis=1), np.linalg.norm(quats + others, axis=1))
    return float(4.0 * np.arcsin(short.max() / 2.0))


def likeness(gaussians: Gaussians, truth: Gaussians) -> float:
    """Return the PSNR in dB of two scenes as the second one's start view shows them, 320 by 180."""
    camera = start_pose(truth, aspect=16 / 9, fov_y=50.0).camera(320, 180, 50.0)
    images = [rasterize(scene, camera, RenderOptions()).colors for scene in (gaussians, truth)]
    assert np.std(images[1]) > 0.02, "the view is empty"
    return psnr(np.clip(images[0], 0, 1), np.clip(images[1], 0, 1))
