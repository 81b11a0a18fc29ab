"""What lies inside of a box or a sphere: splats are kept by their centres, whatever their size."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tsplat.given import real, triple
from tsplat.origin import in_scene
from tsplat.scene import Gaussians, a_scene


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

    Raises
    ------
    OptionError
        A corner is no point.
    """
    ends = triple("corner", corner, finite=False), triple("opposite", opposite, finite=False)
    low, high = (in_scene(a_scene(gaussians), end(*ends)) for end in (np.minimum, np.maximum))
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
        The center is no point, or the radius negative.
    """
    radius = real("the radius of a sphere", radius, "0 or more", 0.0)
    middle = in_scene(a_scene(gaussians), triple("center", center))
    distances = np.linalg.norm(gaussians.means - middle, axis=1)
    return gaussians.take(np.flatnonzero(distances <= radius))
