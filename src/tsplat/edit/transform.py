"""A scene moved as a whole: turned and scaled about the origin, and shifted.

A turn takes everything along that has a direction: centres, the splats themselves, and the harmonics of their
colours, which look at the world from the splat's place.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from tsplat.errors import OptionError
from tsplat.given import real, triple
from tsplat.origin import placed, world_means
from tsplat.rotations import quat_products, rotations_of
from tsplat.scene import Gaussians, Vector, a_scene
from tsplat.sh_rotation import rotate_sh

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]


def rotate(gaussians: Gaussians, degrees: Sequence[float]) -> Gaussians:
    """Turn a scene about the origin.

    Parameters
    ----------
    gaussians : Gaussians
        Any scene.
    degrees : sequence of 3 floats
        About the world's x axis, then its y axis, then its z axis; counterclockwise for someone towards whom the
        axis points.

    Returns
    -------
    Gaussians
        In the same order.
    """
    a_scene(gaussians)
    quat = euler_quat(degrees)
    rotation = rotations_of(quat[None])[0]
    quats = quat_products(quat, gaussians.quats)
    return replace(
        placed(gaussians, world_means(gaussians) @ rotation.T),
        quats=(quats / np.linalg.norm(quats, axis=1, keepdims=True)).astype(np.float32),
        sh=rotate_sh(gaussians.sh, rotation),
        up=_turned(gaussians.up, rotation),
        extra=gaussians.extra and gaussians.extra.turned(rotation),
    )


def translate(gaussians: Gaussians, offset: Sequence[float]) -> Gaussians:
    """Shift a scene by three world units along x, y and z."""
    moved = placed(a_scene(gaussians), world_means(gaussians) + triple("offset", offset))
    return replace(moved, extra=gaussians.extra and gaussians.extra.moved())


def scale(gaussians: Gaussians, factor: float) -> Gaussians:
    """Scale a scene about the origin by a factor above 0.

    Raises
    ------
    OptionError
        The factor is not above 0.
    """
    factor = real("the factor of a scale", factor, "finite and above 0", math.ulp(0.0))
    if factor == math.inf:
        raise OptionError("the factor of a scale must be finite and above 0, got inf")
    with np.errstate(over="ignore"):  # what is beyond float32 is infinite, and refused
        scales = (a_scene(gaussians).scales.astype(np.float64) * factor).astype(np.float32)
    return replace(
        placed(gaussians, world_means(gaussians) * factor),
        scales=scales,
        extra=gaussians.extra and gaussians.extra.moved(),
    )


def _turned(up: Vector | None, rotation: F64) -> Vector | None:
    if up is None:
        return None
    # Quarter turns leave an axis an axis.
    turned = np.round(rotation @ up, 12)
    x, y, z = (float(value) + 0.0 for value in turned / np.linalg.norm(turned))
    return x, y, z


def euler_quat(degrees: Sequence[float]) -> F64:
    """Return the turn about the world's x axis, then its y axis, then its z axis as a unit quat ``wxyz``."""
    quat = np.array([1.0, 0.0, 0.0, 0.0])
    for axis, angle in enumerate(triple("degrees", degrees).tolist()):
        turn = np.zeros(4)
        turn[0], turn[1 + axis] = math.cos(math.radians(angle) / 2), math.sin(math.radians(angle) / 2)
        quat = quat_products(turn, quat[None])[0]
    return quat
