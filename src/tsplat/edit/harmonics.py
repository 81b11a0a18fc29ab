"""Scenes of another degree of spherical harmonics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tsplat.given import whole
from tsplat.scene import SH_COEFFICIENTS, Gaussians, a_scene


def lower_sh_degree(gaussians: Gaussians, degree: int) -> Gaussians:
    """Leave out the harmonics above a degree; a scene that has none is returned as it is.

    The harmonics are orthogonal, so what is left is the best that fewer of them can do.
    """
    degree = whole("degree", degree, 0, len(SH_COEFFICIENTS) - 1)
    return with_sh_degree(gaussians, min(degree, a_scene(gaussians).sh_degree))


def with_sh_degree(gaussians: Gaussians, degree: int) -> Gaussians:
    """Return the scene with harmonics of just this degree: higher ones left out, missing ones zero.

    Parameters
    ----------
    gaussians : Gaussians
        Any scene.
    degree : int
        An index of `SH_COEFFICIENTS`.

    Returns
    -------
    Gaussians
        With ``sh`` of shape [N, SH_COEFFICIENTS[degree], 3].
    """
    degree = whole("degree", degree, 0, len(SH_COEFFICIENTS) - 1)
    if degree == a_scene(gaussians).sh_degree:
        return gaussians
    wanted = SH_COEFFICIENTS[degree]
    common = min(wanted, gaussians.sh.shape[1])
    sh = np.zeros((len(gaussians), wanted, 3), np.float32)
    sh[:, :common] = gaussians.sh[:, :common]
    return replace(gaussians, sh=sh)
