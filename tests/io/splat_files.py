"""Scenes beside their PLY twins, and files tampered with, for the tests of ``.splat`` and ``.ksplat``."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from tests.raster.compare import psnr
from tests.scenes import shared_scenes
from tsplat import io
from tsplat.errors import LoadWarning, TsplatError
from tsplat.framing import start_pose
from tsplat.io.splat import SH_C0
from tsplat.raster import rasterize
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians

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


def mutations(raw: bytes, seed: int, count: int) -> Iterator[bytes]:
    """Yield copies of a file with a few bytes changed, and now and then a piece cut out or doubled."""
    rng = np.random.default_rng(seed)
    solid = np.flatnonzero(np.frombuffer(raw, np.uint8))  # most of a header is padding
    for _ in range(count):
        mutant = bytearray(raw)
        for _ in range(rng.integers(1, 6)):
            near = int(rng.choice(solid)) + int(rng.integers(-3, 4))
            mutant[min(max(near, 0), len(raw) - 1)] = int(rng.choice([0, 1, 127, 128, 255, rng.integers(256)]))
        if rng.random() < 0.2:
            first, last = np.sort(rng.integers(0, len(raw), 2))
            mutant[first:last] = b"" if rng.random() < 0.5 else bytes(mutant[first:last]) * 2
        yield bytes(mutant)


def loads_or_says_why(path: Path) -> bool:
    """Load a file that may be broken; anything but a scene or one clear line fails the test."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", LoadWarning)
        try:
            io.load(path)
        except TsplatError as error:
            problem = str(error)
        else:
            return True
    assert str(path) in problem
    assert "\n" not in problem
    return False
