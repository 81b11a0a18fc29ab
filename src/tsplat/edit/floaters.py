"""Floaters: splats that are alone where others have company.

Source: Rusu et al. 2008, *Towards 3D point cloud based object maps for household environments*, section 4.1,
known as statistical outlier removal.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tsplat.scene import Gaussians

NEIGHBOURS = 16
"""How many of the nearest say how alone a splat is: enough to even out noise, and few beside any real thing."""

SIGMAS = 2.0
"""Standard deviations above the mean that are too many; the fewer, the more is removed."""


def remove_floaters(
    gaussians: Gaussians, sigmas: float = SIGMAS, progress: Callable[[float], None] | None = None
) -> Gaussians:
    """Remove the splats whose mean distance to their nearest neighbours is far above what is usual in the scene.

    Parameters
    ----------
    gaussians : Gaussians
        Any scene.
    sigmas : float
        A splat goes when its mean distance to its `NEIGHBOURS` nearest is more than this many standard deviations
        above the mean of all these distances.
    progress : callable, optional
        Called with the fraction done, growing from 0 to 1.

    Returns
    -------
    Gaussians
        In the same order.
    """
    from tsplat.edit.neighbours import mean_distances  # brings in Numba, which other edits do without

    distances = mean_distances(gaussians.means, NEIGHBOURS, progress)
    if not len(distances):
        return gaussians
    return gaussians.take(np.flatnonzero(distances <= distances.mean() + sigmas * distances.std()))
