"""What lies inside of a box or a sphere: splats are kept by their centres, whatever their size."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tsplat.errors import OptionError
from tsplat.origin import in_scene
from tsplat.scene import Gaussians


def crop_box(gaussians: Gaussians, corner: Sequence[float], opposite: Sequence[float]) -> Gaussians:
    """Keep the splats whose centres lie in a box along the axes, its faces included.

    Parameters
    ----------
    gaussians : Gaussians
        Any scene.
    corner, opposite : sequence of 3 floats
        Any two opposite corners, in world units.

    Returns
    -------
    Gaussians
        In the same order.
    """
    low, high = (in_scene(gaussians, ends(corner, opposite)) for ends in (np.minimum, np.maximum))
    inside = (gaussians.means >= low) & (gaussians.means <= high)
    return gaussians.take(np.flatnonzero(inside.all(axis=1)))


def crop_sphere(gaussians: Gaussians, center: Sequence[float], radius: float) -> Gaussians:
    """Keep the splats whose centres lie in a sphere, its surface included.

    Parameters
    ----------
    gaussians : Gaussians
        Any scene.
    center : sequence of 3 floats
        In world units.
    radius : float
        In world units, 0 or more.

    Returns
    -------
    Gaussians
        In the same order.

    Raises
    ------
    OptionError
        The radius is negative.
    """
    if not radius >= 0.0:
        raise OptionError(f"the radius of a sphere must be 0 or more, got {radius}")
    distances = np.linalg.norm(gaussians.means - in_scene(gaussians, center), axis=1)
    return gaussians.take(np.flatnonzero(distances <= radius))
