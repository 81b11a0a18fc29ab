"""Floaters: splats that are alone where others have company.

Where a surface is smooth, few large splats make it, each far from the next, and none of them floats. So distances
are measured in sizes of the splats; the rest is as usual for points.

Source: Rusu et al. 2008, *Towards 3D Point Cloud Based Object Maps for Household Environments*, which is known as
statistical outlier removal.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tsplat.given import real
from tsplat.scene import Gaussians, a_scene

NEIGHBOURS = 16
"""How many of the nearest say how alone a splat is: enough to even out noise, and few beside any real thing."""

SIGMAS = 2.0
"""Standard deviations above the mean that are too many; the fewer, the more is removed."""


def remove_floaters(
    gaussians: Gaussians, sigmas: float = SIGMAS, progress: Callable[[float], None] | None = None
) -> Gaussians:
    """Remove the splats that are farther from their nearest neighbours, for their sizes, than is usual here.

    Parameters
    ----------
    gaussians : Gaussians
        Any scene.
    sigmas : float
        How alone a splat is is the logarithm of 1 + its mean distance to its `NEIGHBOURS` nearest, in units of the
        longest standard deviations of both. It goes when that is so many standard deviations above the mean.
    progress : callable, optional
        Called with the fraction done, growing from 0 to 1.

    Returns
    -------
    Gaussians
        In the same order.
    """
    sigmas = real("sigmas", sigmas)
    if not len(a_scene(gaussians)):
        return gaussians
    from tsplat.neighbours import mean_gaps  # kernels, which other edits do without

    # The logarithm keeps a single splat beyond all measure from making everything else usual.
    alone = np.log1p(mean_gaps(gaussians.means, gaussians.scales.max(axis=1), NEIGHBOURS, progress))
    return gaussians.take(np.flatnonzero(alone <= alone.mean() + sigmas * alone.std()))
