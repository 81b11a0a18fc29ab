"""The values of each splat that `tsplat info` looks at."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tsplat.framing import Bulk
from tsplat.scene import SH_C0, Gaussians

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False, slots=True)
class Measures:
    """Values of N splats, all finite and none but the colours negative.

    Attributes
    ----------
    opacities : ndarray of float32, [N]
        As in `Gaussians`.
    longest : ndarray of float32, [N]
        The longest of the three standard deviations, in world units.
    flatness : ndarray of float32, [N]
        The shortest over the longest, from 0 to 1; 0 for a splat without any extent.
    distances : ndarray of float32, [N]
        Of the centre from the middle of the bulk, in radii of the bulk.
    colors : ndarray of float32, [N, 3]
        Red, green and blue, mean over all directions; meant to lie in [0, 1].
    view_dependence : ndarray of float32, [N], or None
        How far the colour strays from that mean: root mean square over all directions and the three channels;
        None where the scene has SH degree 0.
    """

    opacities: F32
    longest: F32
    flatness: F32
    distances: F32
    colors: F32
    view_dependence: F32 | None


def measure(gaussians: Gaussians, box: Bulk) -> Measures:
    """Return the values of all splats of a scene whose bulk is ``box``."""
    # Columns one by one: NumPy takes eight times as long for a minimum over an axis of three.
    x, y, z = gaussians.scales.T
    longest = np.maximum(np.maximum(x, y), z)
    shortest = np.minimum(np.minimum(x, y), z)
    return Measures(
        opacities=gaussians.opacities,
        longest=longest,
        flatness=np.divide(shortest, longest, out=np.zeros_like(longest), where=longest > 0.0),
        distances=_distances(gaussians.means, box),
        colors=_colors(gaussians.sh),
        view_dependence=_view_dependence(gaussians.sh) if gaussians.sh_degree else None,
    )


def _distances(means: F32, box: Bulk) -> F32:
    offsets = (column - middle for column, middle in zip(means.T, box.center, strict=True))
    return _float32(np.sqrt(sum(offset * offset for offset in offsets)) / box.radius)


def _colors(sh: F32) -> F32:
    colors: F32 = 0.5 + np.float32(SH_C0) * sh[:, 0]
    return colors


def _view_dependence(sh: F32) -> F32:
    # The harmonics are orthonormal: the mean square over the sphere is the sum of squares over its area.
    rest = sh.reshape(len(sh), 3 * sh.shape[1])[:, 3:]
    with np.errstate(over="ignore"):
        squares = np.einsum("ij,ij->i", rest, rest)
    if not np.isfinite(squares).all():
        squares = np.einsum("ij,ij->i", rest, rest, dtype=np.float64)
    return _float32(np.sqrt(squares / (3.0 * 4.0 * math.pi)))


def _float32(values: F32 | F64) -> F32:
    # Half the bytes are sorted in half the time.
    return np.minimum(values, np.finfo(np.float32).max).astype(np.float32)
