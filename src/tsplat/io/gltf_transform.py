"""Splats moved by a matrix: centres, ellipsoids and the colours that change with the view.

Source: KHR_gaussian_splatting, sections *Splat Reconstruction* and *Splat Lighting*: an ellipsoid takes any
matrix, colours only its rotation.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tsplat.io.arrays import Arrays
from tsplat.rotations import quat_products, quats_of, rotations_of
from tsplat.sh_rotation import rotate_sh

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]

CHUNK = 1 << 16
"""Splats moved at a time."""

EVEN = 1e-6
"""Scales along the axes of a matrix that differ by less are one scale."""


def move(splats: Arrays, matrix: F64) -> None:
    """Move splats in place.

    Parameters
    ----------
    splats : Arrays
        Of a mesh.
    matrix : ndarray of float64, [4, 4]
        Its last row is not looked at. With a mirror, ellipsoids and colours are mirrored.
    """
    linear, offset = matrix[:3, :3], matrix[:3, 3]
    if not np.isfinite(matrix).all():
        splats.means[:] = np.nan
        return
    left, stretches, right = np.linalg.svd(linear)
    nearest = left @ right
    even = stretches[0] - stretches[2] <= EVEN * stretches[0]
    turn = quats_of((nearest * np.sign(np.linalg.det(nearest)))[None])[0]
    for first in range(0, len(splats.means), CHUNK):
        part = Arrays(*(each[first : first + CHUNK] for each in splats))
        part.means[:] = part.means @ linear.T + offset
        part.sh[:] = rotate_sh(part.sh, nearest)
        if even:
            part.quats[:] = quat_products(turn, part.quats)
            part.scales[:] *= stretches.mean()
        else:
            _deform(part.quats, part.scales, linear)


def _deform(quats: F32, scales: F32, linear: F64) -> None:
    lengths = np.sqrt(np.einsum("ij,ij->i", quats, quats, dtype=np.float64))  # squares leave float32 soon
    axes = linear @ rotations_of(quats / lengths[:, None]) * scales[:, None, :]
    good = np.isfinite(axes).all(axis=(1, 2))  # the others are dropped, but for these it would not converge
    left, stretches, _ = np.linalg.svd(axes[good])
    left[:, :, 2] *= np.linalg.det(left)[:, None]
    quats[good], scales[good] = quats_of(left), stretches
