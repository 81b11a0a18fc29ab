"""What the cameras had in view that a scene was trained from: how near they came to each splat follows from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from tsplat.camera import Camera

F32 = npt.NDArray[np.float32]

MOST = 256
"""Cameras taken; of more, so many spread evenly over the list, as each is compared with every splat."""

NEAREST = 0.2
"""World units; nothing nearer to the eye is drawn by the training code of Kerbl et al. 2023."""

REACH = 1.3
"""How much wider a view is than its picture: splats with their middle outside of it still reached into it."""

NUMBERS = 12
"""Of each view: three rows of four."""


@dataclass(frozen=True, eq=False, slots=True)
class TrainViews:
    """The views of some training cameras.

    Attributes
    ----------
    frusta : ndarray of float32, [C, 3, 4]
        Each takes a point (x, y, z, 1) to sideways, down and depth, such that it is in view exactly where
        ``abs(sideways) < depth``, ``abs(down) < depth`` and ``depth > NEAREST``; depth is in world units.
    """

    frusta: F32

    @classmethod
    def of(cls, cameras: Sequence[Camera]) -> Self | None:
        """Return the views of cameras in the axes of the scene; None for no cameras."""
        if not cameras:
            return None
        places = np.linspace(0, len(cameras) - 1, min(len(cameras), MOST)).round().astype(int)
        with np.errstate(over="ignore", invalid="ignore"):  # so far away, a camera has nothing in view
            frusta = np.stack([_frustum(cameras[place]) for place in places]).astype(np.float32)
        frusta.flags.writeable = False
        return cls(frusta)


def _frustum(camera: Camera) -> npt.NDArray[np.float64]:
    right, down, depth, _ = camera.viewmat
    (fx, _, cx), (_, fy, cy), _ = camera.K
    half_x, half_y = 0.5 * camera.width, 0.5 * camera.height
    sideways = (fx * right + (cx - half_x) * depth) / (REACH * half_x)
    return np.stack([sideways, (fy * down + (cy - half_y) * depth) / (REACH * half_y), depth])
