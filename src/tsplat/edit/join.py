"""Several scenes as one."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from tsplat.edit.harmonics import with_sh_degree
from tsplat.errors import LoadWarning, SceneError, shown
from tsplat.scene import Gaussians, a_scene


def join(scenes: Sequence[Gaussians]) -> Gaussians:
    """Return all splats of some scenes, one scene after the other.

    Parameters
    ----------
    scenes : sequence of Gaussians
        At least one.

    Returns
    -------
    Gaussians
        Of the highest degree of harmonics among them, the missing ones zero; antialiased where all are.

    Warns
    -----
    LoadWarning
        Some are antialiased and some are not: no way to draw them suits all.
    """
    if not isinstance(scenes, Sequence) or not len(scenes):
        raise SceneError(f"scenes must be a list of one or more, got {shown(scenes)}")
    for scene in scenes:
        a_scene(scene)
    if len(scenes) == 1:
        return scenes[0]
    antialiased = sum(scene.antialiased for scene in scenes)
    if 0 < antialiased < len(scenes):
        problem = f"{antialiased} of {len(scenes)} scenes are antialiased; joined, none counts as antialiased"
        warnings.warn(problem, LoadWarning, stacklevel=2)
    degree = max(scene.sh_degree for scene in scenes)
    arrays = zip(*(with_sh_degree(scene, degree).arrays for scene in scenes), strict=True)
    means, quats, scales, opacities, sh = (np.concatenate(parts) for parts in arrays)
    return Gaussians(means, quats, scales, opacities, sh, antialiased == len(scenes))
