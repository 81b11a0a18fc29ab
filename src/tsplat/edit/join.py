"""Several scenes as one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

import numpy as np

from tsplat.edit.harmonics import with_sh_degree
from tsplat.scene import Gaussians


def join(scenes: Sequence[Gaussians]) -> Gaussians:
    """Return all splats of some scenes, one scene after the other.

    Parameters
    ----------
    scenes : sequence of Gaussians
        At least one.

    Returns
    -------
    Gaussians
        Of the highest degree of harmonics among them, the missing ones zero.
    """
    first, *others = scenes
    if not others:
        return first
    degree = max(scene.sh_degree for scene in scenes)
    alike = [with_sh_degree(scene, degree) for scene in scenes]
    names = [field.name for field in fields(first)]
    return Gaussians(*(np.concatenate([getattr(scene, name) for scene in alike]) for name in names))
