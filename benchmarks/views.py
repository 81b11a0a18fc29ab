"""Real scenes for measures of quality: where they lie, their training focal length, a start view, the truth."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tsplat.camera import Camera, Pose
from tsplat.framing import start_pose
from tsplat.io import load
from tsplat.raster import rasterize
from tsplat.rendering import Antialias, RenderOptions
from tsplat.scene import Gaussians

F64 = npt.NDArray[np.float64]

BESIDE = Path(__file__).resolve().parents[2] / "shared" / "scenes"
SCENES = Path(os.environ.get("TSPLAT_SCENES", BESIDE))
SNOWMIKU = SCENES / "snowmiku"
SNOWMIKU_FOCAL = 205.3247
"""Pixels; its photographs of 248x186 were trained on, so says its list of transforms."""

SIZE = 240, 160
FOV_Y = 55.0
SUPERSAMPLED = 4


@dataclass(frozen=True, slots=True)
class Scene:
    """A scene, where its view begins, and the focal length it was trained at, or taken to be.

    Where no training camera is known, it is that of the truth: the truth is then the scene as trained.
    """

    name: str
    gaussians: Gaussians
    pose: Pose
    train_focal: float

    def options(self, antialias: Antialias) -> RenderOptions:
        """Return how to draw it."""
        return RenderOptions(antialias=antialias, train_focal=self.train_focal, depths=False)

    def draw(self, pose: Pose, antialias: Antialias) -> F64:
        """Return what is seen at 240x160."""
        return colors(self.gaussians, pose.camera(*SIZE, FOV_Y), self.options(antialias))

    def truth(self, pose: Pose) -> F64:
        """Return the same, supersampled: at four times the size, then each pixel the mean of its sixteen."""
        width, height = (SUPERSAMPLED * side for side in SIZE)
        large = colors(self.gaussians, pose.camera(width, height, FOV_Y), self.options("relative"))
        return boxed(large, SUPERSAMPLED)


def scenes() -> list[Scene]:
    """Load the scenes."""
    return [
        _scene("playbot, 500k", "ply/playbot_500k_sh2.ply"),
        _scene("plant, 114k", "ply/plant.ply"),
        _scene("tarot cards, 115k", "ply/academic_tarot_cards.ply"),
        _scene("snowmiku, 38k", "snowmiku/trained/snow_sh3_3000.ply", SNOWMIKU_FOCAL),
    ]


def _scene(name: str, path: str, train_focal: float | None = None) -> Scene:
    gaussians = load(SCENES / path)
    pose = start_pose(gaussians, aspect=SIZE[0] / SIZE[1], fov_y=FOV_Y)
    as_trained = pose.camera(SUPERSAMPLED * SIZE[0], SUPERSAMPLED * SIZE[1], FOV_Y)
    return Scene(name, gaussians, pose, train_focal or float(as_trained.K[0, 0]))


def colors(gaussians: Gaussians, camera: Camera, options: RenderOptions) -> F64:
    """Return what a camera sees, 0 to 1."""
    return np.clip(rasterize(gaussians, camera, options).colors.astype(np.float64), 0.0, 1.0)


def boxed(image: F64, divisor: int) -> F64:
    """Return the means of squares of so many pixels; what is left over on the right and below is cut off."""
    height, width = (side // divisor for side in image.shape[:2])
    cut = image[: height * divisor, : width * divisor]
    means: F64 = cut.reshape(height, divisor, width, divisor, 3).mean(axis=(1, 3))
    return means


def high_frequencies(image: F64) -> F64:
    """Return an image minus its blur by 3x3 pixels."""
    padded = np.pad(image, ((1, 1), (1, 1), (0, 0)), "edge")
    height, width = image.shape[:2]
    shifted = (padded[y : y + height, x : x + width] for y in range(3) for x in range(3))
    return image - sum(shifted, np.zeros_like(image)) / 9.0


def rms(values: F64) -> float:
    """Return the root of the mean square."""
    return math.sqrt(float(np.mean(np.square(values))))


def psnr(image: F64, truth: F64) -> float:
    """Return the peak signal-to-noise ratio in dB."""
    return -20.0 * math.log10(rms(image - truth))
