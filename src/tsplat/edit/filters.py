"""Splats that are too faint or too large, by what each of them says about itself."""

from __future__ import annotations

import numpy as np

from tsplat.given import real
from tsplat.scene import Gaussians, a_scene


def drop_faint(gaussians: Gaussians, min_opacity: float) -> Gaussians:
    """Keep the splats of at least this opacity.

    Parameters
    ----------
    gaussians : Gaussians
        Any scene.
    min_opacity : float
        From 0, which keeps all, to 1.

    Returns
    -------
    Gaussians
        In the same order.
    """
    with np.errstate(over="ignore"):
        least = np.float32(real("min_opacity", min_opacity))
    return a_scene(gaussians).take(np.flatnonzero(gaussians.opacities >= least))


def drop_large(gaussians: Gaussians, max_scale: float) -> Gaussians:
    """Keep the splats whose longest standard deviation is at most this.

    Parameters
    ----------
    gaussians : Gaussians
        Any scene.
    max_scale : float
        In world units.

    Returns
    -------
    Gaussians
        In the same order.
    """
    with np.errstate(over="ignore"):
        most = np.float32(real("max_scale", max_scale))
    return a_scene(gaussians).take(np.flatnonzero(gaussians.scales.max(axis=1) <= most))
