"""Once around a scene, in frames that end one step before they begin again."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tsplat.camera import Camera, Pose
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians

U8 = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Orbit:
    """The frames of a camera that goes around what it looks at.

    Attributes
    ----------
    gaussians : Gaussians
        The scene.
    options : RenderOptions
        How to draw it.
    start : Pose
        The first frame's view.
    screen : tuple of 2 ints
        Width and height as they are seen, in square pixels.
    size : tuple of 2 ints
        Width and height of a frame, stretched to ``screen`` when it is shown.
    fov_y : float
        Vertical field of view in degrees.
    count : int
        Frames, 1 or more.
    turns : int
        How often around, as the viewer's automatic orbit goes; backwards when negative.
    """

    gaussians: Gaussians
    options: RenderOptions
    start: Pose
    screen: tuple[int, int]
    size: tuple[int, int]
    fov_y: float
    count: int
    turns: int

    def __len__(self) -> int:
        return self.count

    def camera(self, index: int) -> Camera:
        """Return the camera of a frame; that of frame ``count`` would be the first one's."""
        yaw = -2.0 * math.pi * self.turns * index / self.count
        return self.start.orbit(yaw, 0.0).camera(*self.screen, self.fov_y).resized(*self.size)

    def __getitem__(self, index: int) -> U8:
        from tsplat.raster import rasterize

        return rasterize(self.gaussians, self.camera(index), self.options).frame()
