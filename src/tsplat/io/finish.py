"""What every reader does last: leave out what cannot be drawn, keep the weightiest, make the scene."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tsplat.errors import LoadWarning
from tsplat.importance import importance, most_important
from tsplat.scene import Gaussians

F32 = npt.NDArray[np.float32]


def finish(
    path: Path,
    means: F32,
    quats: F32,
    scales: F32,
    opacities: F32,
    sh: F32,
    *,
    max_splats: int | None,
    antialiased: bool = False,
) -> Gaussians:
    """Return the scene of a file.

    Parameters
    ----------
    path : Path
        The file, for the warning.
    means, scales : ndarray of float32, [N, 3]
        As in `Gaussians`.
    quats : ndarray of float32, [N, 4]
        ``wxyz``, of any length above zero.
    opacities : ndarray of float32, [N]
        From 0 to 1.
    sh : ndarray of float32, [N, K, 3]
        As in `Gaussians`.
    max_splats : int or None
        Keep at most this many, those with the largest opacity times area.
    antialiased : bool
        As in `Gaussians`.

    Warns
    -----
    LoadWarning
        Splats with nan, inf or a zero quat were left out.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # what that makes is what is looked for
        lengths = np.linalg.norm(quats, axis=1)
        sums = means.sum(1) + scales.sum(1) + opacities + sh.sum((1, 2))
    good = np.isfinite(sums) & np.isfinite(lengths) & (lengths > 0)
    if dropped := len(good) - int(good.sum()):
        problem = f"dropped {dropped} of {len(good)} splats: nan, inf or a zero quat"
        warnings.warn(f"{path}: {problem}", LoadWarning, stacklevel=4)
    if max_splats is not None and max_splats < good.sum():
        kept = np.flatnonzero(good)
        good = np.zeros_like(good)
        good[kept[most_important(importance(scales[kept], opacities[kept]), max_splats)]] = True
    if not good.all():
        means, quats, scales, opacities, sh = (part[good] for part in (means, quats, scales, opacities, sh))
        lengths = lengths[good]
    return Gaussians(means, quats / lengths[:, None], scales, opacities, sh, antialiased)
