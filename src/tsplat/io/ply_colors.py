"""Colours of a PLY that are no harmonics: red, green and blue of any type, or what a scanner measured."""

from __future__ import annotations

import numpy as np

from tsplat.io.arrays import F32, chunks
from tsplat.io.ply_columns import Colors
from tsplat.scene import SH_C0

OVEREXPOSED = 2.0
"""Colours from 0 to 1 may be a little brighter than 1; what is beyond this is counted in bytes."""

DARKEST, BRIGHTEST = 1.0, 99.0
"""Percentiles of intensities that are drawn black and white: their unit is the scanner's own."""


def to_harmonics(base: F32, colors: Colors, code: str) -> None:
    """Make first coefficients of other colours, in place.

    Parameters
    ----------
    base : ndarray of float32, [N, 3]
        Values as the file has them; of no colours, anything, which becomes grey.
    colors : {"harmonics", "rgb", "intensity", "none"}
        What they are.
    code : str
        NumPy's code of the type that the file has them in.
    """
    if colors == "none":
        base[:] = 0.0
    elif colors == "rgb":
        _rescale(base, 0.0, _white(base, code))
    elif colors == "intensity":
        known = base[np.isfinite(base[:, 0]), 0].astype(np.float64)
        low, high = np.percentile(known, (DARKEST, BRIGHTEST)) if len(known) else (0.0, 1.0)
        _rescale(base, float(low), float(high))
        np.clip(base, -0.5 / SH_C0, 0.5 / SH_C0, out=base)


def _white(base: F32, code: str) -> float:
    """Return what the brightest colour is written as; the type says so for bytes only."""
    largest = float(np.max(base, initial=0.0, where=np.isfinite(base)))
    if code == "u1":
        return 255.0
    if code[0] == "f" and largest <= OVEREXPOSED:
        return 1.0
    return 255.0 if largest <= 255.0 else 65535.0


def _rescale(base: F32, black: float, white: float) -> None:
    factor, middle = np.float32(1.0 / (max(white - black, 1e-30) * SH_C0)), np.float32(0.5 / SH_C0)
    with np.errstate(all="ignore"):  # what that makes is left out
        for rows in chunks(len(base)):
            base[rows] = (base[rows] - np.float32(black)) * factor - middle
