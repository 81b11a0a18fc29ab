"""Several scenes as one."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tsplat.edit.harmonics import with_sh_degree
from tsplat.errors import LoadWarning, SceneError, shown
from tsplat.extra import joined as joined_extra
from tsplat.origin import find_origin, placed, world_means
from tsplat.scene import Gaussians, Vector, a_scene


def join(scenes: Sequence[Gaussians]) -> Gaussians:
    """Return all splats of some scenes, one scene after the other.

    Parameters
    ----------
    scenes : sequence of Gaussians
        At least one.

    Returns
    -------
    Gaussians
        Of the highest degree of harmonics among them, the missing ones zero; antialiased where all are; with what
        is up where those that say so agree.

    Warns
    -----
    LoadWarning
        Some are antialiased and some are not: no way to draw them suits all. Or some have another side up, or
        lie so far from the others that float32 does not hold both.
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
    joined = Gaussians(means, quats, scales, opacities, sh, antialiased == len(scenes), _common_up(scenes))
    joined = replace(joined, extra=joined_extra([scene.extra for scene in scenes], [*map(len, scenes)]))
    if all(scene.origin is None for scene in scenes):
        return joined
    joined = placed(joined, np.concatenate([world_means(scene) for scene in scenes]))
    _warn_far(scenes, joined.origin)
    return joined


def _warn_far(scenes: Sequence[Gaussians], origin: Vector | None) -> None:
    for number, scene in enumerate(scenes, 1):
        means = world_means(scene) - (origin or 0.0)
        if find_origin(means):
            steps = float(np.spacing(np.float32(np.abs(means).max())))
            problem = (
                f"scene {number} of {len(scenes)} lies so far from the others that its splats are placed in steps"
            )
            warnings.warn(f"{problem} of {steps:.3g}; --translate it before", LoadWarning, stacklevel=3)


def _common_up(scenes: Sequence[Gaussians]) -> Vector | None:
    ups = [scene.up for scene in scenes if scene.up]
    if not ups or np.allclose(ups, ups[0], atol=1e-6):
        return ups[0] if ups else None
    problem = f"{len(ups)} of {len(scenes)} scenes say what is up, and not the same; joined, it is not known"
    warnings.warn(f"{problem}; turn some of them by --rotate before", LoadWarning, stacklevel=3)
    return None
