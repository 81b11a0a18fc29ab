"""How alike two scenes are: as pictures, and as rotations."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tsplat.framing import start_pose
from tsplat.raster import rasterize
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians

F32 = npt.NDArray[np.float32]


def matrix(quat: F32) -> npt.NDArray[np.float64]:
    """Return the rotation of a quat ``wxyz``."""
    w, x, y, z = (float(value) for value in quat)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + 2 * w * cross + 2 * cross @ cross)


def picture(gaussians: Gaussians, view: Gaussians) -> F32:
    """Return a scene as it is seen from where the viewer would begin with ``view``."""
    camera = start_pose(view, aspect=16 / 9, fov_y=50.0).camera(320, 180, 50.0)
    return rasterize(gaussians, camera, RenderOptions()).colors


def angles(quats: F32, others: F32) -> npt.NDArray[np.float64]:
    """Return the angle of each rotation from its twin in degrees."""
    cosines = np.abs(np.einsum("ij,ij->i", quats.astype(np.float64), others))
    return np.asarray(np.degrees(2 * np.arccos(np.minimum(cosines, 1))))
