"""Points without sizes, of a scanner or COLMAP, as splats: opaque balls as large as their neighbours are near."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from tsplat.errors import LoadWarning
from tsplat.io.arrays import F32, Arrays
from tsplat.io.finish import Mask, mend_all

NEIGHBOURS = 3
"""As many as the training of splats looks at when it begins with points (Kerbl et al. 2023, section 5.1)."""

SIGMA = 0.5
"""Standard deviation in mean distances of the neighbours: surfaces are closed, and points can be told apart."""

SPREAD = 4.0
"""Points are at most so many times as large or small as is usual: one far away hides nothing, twins are seen."""


def make_balls(path: Path, arrays: Arrays, what: str) -> Mask:
    """Fill all but means and colours, say that a file holds no splats, and mark the points that can be drawn.

    Parameters
    ----------
    path : Path
        The file, for the warning.
    arrays : Arrays
        With means and colours.
    what : str
        What the file is: a noun with its article.

    Returns
    -------
    ndarray of bool, [N]
        For `tsplat.io.finish.finish`.

    Warns
    -----
    LoadWarning
        Always.
    """
    problem = f"is {what}: its {len(arrays.means)} points are drawn as balls, sized by their neighbours"
    warnings.warn(f"{path}: {problem}; for splats, open what training wrote", LoadWarning, stacklevel=4)
    arrays.quats[:] = 1.0, 0.0, 0.0, 0.0
    arrays.scales[:], arrays.opacities[:] = 0.0, 1.0
    good = mend_all(arrays)
    arrays.scales[good] = point_sizes(arrays.means[good])[:, None]
    return good


def point_sizes(means: F32) -> F32:
    """Return a standard deviation for each point, float32 [N], in world units.

    Parameters
    ----------
    means : ndarray of float32, [N, 3]
        Finite; some may lie at the same place.
    """
    from tsplat.neighbours import mean_gaps  # kernels, which other readers do without

    # By sizes of a half each, a gap is the distance itself.
    gaps = mean_gaps(means, np.full(len(means), 0.5, np.float32), NEIGHBOURS)
    apart = gaps[gaps > 0.0]
    if not len(apart):
        return np.full(len(means), SIGMA, np.float32)
    usual = float(np.median(apart))
    sizes = SIGMA * np.clip(gaps, usual / SPREAD, usual * SPREAD)
    return np.minimum(sizes, np.finfo(np.float32).max).astype(np.float32)
