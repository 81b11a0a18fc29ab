"""A scene cut down to so many splats."""

from __future__ import annotations

import numpy as np

from tsplat.given import whole
from tsplat.importance import importance, most_important
from tsplat.scene import Gaussians, a_scene


def keep_most_important(gaussians: Gaussians, count: int) -> Gaussians:
    """Keep at most ``count`` splats, those with the largest opacity times area, in the same order."""
    count = whole("count", count, 0)
    if count >= len(a_scene(gaussians)):
        return gaussians
    scores = importance(gaussians.scales, gaussians.opacities)
    return gaussians.take(np.flatnonzero(most_important(scores, count)))
