"""What there is of surfaces in a scene, and which way each piece of them faces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tsplat.framing.bulk import Bulk
from tsplat.framing.sample import Mask, step_of
from tsplat.rotations import rotations_of
from tsplat.scene import SH_C0, Gaussians

F64 = npt.NDArray[np.float64]

FLATNESS = 0.4
"""A splat is flat when its shortest axis is below this share of the next: it lies in a surface."""

AROUND = 1.2
"""Radii of the bulk within which surfaces are looked at."""

LUMA = np.array([0.2126, 0.7152, 0.0722])
"""How bright each primary looks, ITU-R BT.709."""


@dataclass(frozen=True, eq=False, slots=True)
class Surface:
    """M splats of and around the bulk.

    Attributes
    ----------
    means : ndarray of float64, [M, 3]
        Centres in world units.
    normals : ndarray of float64, [M, 3]
        Unit, of no side in particular.
    flat : ndarray of float64, [M]
        Opacity times area where the splat is flat, else 0.
    solid : ndarray of float64, [M]
        Opacity times area, of large splats no more than the median's: how much is there.
    luminance : ndarray of float64, [M]
        Mean over all directions, mostly from 0 to 1.
    sizes : ndarray of float64, [M]
        Edges of squares as large as the splats, in world units.
    """

    means: F64
    normals: F64
    flat: F64
    solid: F64
    luminance: F64
    sizes: F64

    def only(self, keep: Mask) -> Surface:
        """Return those splats that are marked, [M]."""
        return Surface(self.means[keep], self.normals[keep], self.flat[keep], self.solid[keep],
                       self.luminance[keep], self.sizes[keep])  # fmt: skip


def surface(gaussians: Gaussians, box: Bulk) -> Surface:
    """Return the surfaces of a sample of a scene, which is not empty."""
    step = step_of(gaussians)
    means = gaussians.means[::step].astype(np.float64)
    scales = gaussians.scales[::step].astype(np.float64)
    opacities = gaussians.opacities[::step].astype(np.float64)
    shortest, ordered = np.argmin(scales, axis=1), np.sort(scales, axis=1)
    areas = ordered[:, 1] * ordered[:, 2]
    flat = opacities * np.minimum(areas, np.quantile(areas, 0.95))
    flat[ordered[:, 0] >= FLATNESS * ordered[:, 1]] = 0.0
    normals = rotations_of(gaussians.quats[::step])[np.arange(len(means)), :, shortest]
    luminance = (0.5 + SH_C0 * gaussians.sh[::step, 0].astype(np.float64)) @ LUMA
    solid = opacities * np.minimum(areas, np.median(areas))
    every = Surface(means, normals, flat, solid, luminance, np.sqrt(areas))
    return every.only(np.linalg.norm(means - box.center, axis=1) <= AROUND * box.radius)
