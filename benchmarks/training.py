"""Snowmiku's training cameras: held-out photographs at every size, and how near the cameras came to each splat."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from PIL import Image

from tsplat.camera import Camera
from tsplat.io import load_cameras
from tsplat.rendering import BOX_VARIANCE, EPS2D, RenderOptions
from tsplat.scene import Gaussians
from views import F64, SNOWMIKU, SNOWMIKU_FOCAL, boxed

HELD_OUT = 8
"""Every so many photographs, one was not trained on."""

MARGIN = 0.15
"""Splats this far outside of an image, in its sides, still reached into it in training."""


class Unsoftened(RenderOptions):
    """As `RenderOptions`, without the blur after blending."""

    def softening(self, focal: float) -> float:  # noqa: ARG002
        """Return that there is none."""
        return 0.0


class Baked(RenderOptions):
    """For splats that hold their dilation already: only the pixel's box is added."""

    def filter2d(self, focal: float) -> tuple[float, float]:
        """Return the box as far as pixels grew, and that the opacity is right without it."""
        return max(0.0, 1.0 - (focal / self.train_focal) ** 2) * BOX_VARIANCE, 0.0


def photographs(divisor: int) -> list[tuple[Camera, F64]]:
    """Return the held-out photographs and their cameras at so many times less than the training size."""
    found = []
    for view in load_cameras(SNOWMIKU / "cameras.json")[::HELD_OUT]:
        with Image.open(SNOWMIKU / "images_16" / f"{view.name}.png") as picture:
            photograph = boxed(np.asarray(picture.convert("RGB"), np.float64) / 255.0, divisor)
        height, width = photograph.shape[:2]
        found.append((_at_training_size(view.camera, divisor, width, height), photograph))
    return found


def trained_on() -> list[Camera]:
    """Return the cameras of all photographs but those held out."""
    cameras = load_cameras(SNOWMIKU / "cameras.json")
    return [view.camera for index, view in enumerate(cameras) if index % HELD_OUT]


def _at_training_size(camera: Camera, divisor: int, width: int, height: int) -> Camera:
    K = camera.K * (SNOWMIKU_FOCAL / camera.K[0, 0] / divisor)
    K[2, 2] = 1.0
    return Camera(camera.viewmat, K, width, height)


def training_depths(gaussians: Gaussians) -> F64:
    """Return the depths of all splats in all cameras trained on, nan where they are out of sight, [cameras, N]."""
    return np.stack([_depths(gaussians, camera) for camera in trained_on()])


def _depths(gaussians: Gaussians, camera: Camera) -> F64:
    x, y, z = (gaussians.means @ camera.viewmat[:3, :3].T + camera.viewmat[:3, 3]).T
    (fx, _, cx), (_, fy, cy), _ = camera.K
    with np.errstate(all="ignore"):
        right, down = (fx * x / z + cx) / camera.width, (fy * y / z + cy) / camera.height
    inside = (abs(right - 0.5) < 0.5 + MARGIN) & (abs(down - 0.5) < 0.5 + MARGIN) & (z > 0.2)
    return np.where(inside, z, np.nan)


def baked(gaussians: Gaussians, depths: F64) -> Gaussians:
    """Return splats that hold the dilation of training at these depths: a ball is added to each, so scales do.

    Source: Yu et al. 2024, *Mip-Splatting*, eq. 7, with the dilation that this scene was trained with.
    """
    known = np.where(np.isfinite(depths), depths, np.nanmedian(depths))
    variance = EPS2D * (known / SNOWMIKU_FOCAL) ** 2
    scales = np.sqrt(gaussians.scales.astype(np.float64) ** 2 + variance[:, None])
    return replace(gaussians, scales=scales.astype(np.float32))
