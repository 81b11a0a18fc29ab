"""What every reader does last: leave out what cannot be drawn, keep the weightiest, make the scene.

Everything happens within the arrays that the reader filled, so a scene is in memory once.
"""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tsplat.errors import LoadError, LoadWarning
from tsplat.extra import Extra
from tsplat.importance import importance, most_important
from tsplat.io.arrays import Arrays, chunks
from tsplat.io.threads import on_threads
from tsplat.origin import find_origin, take_off
from tsplat.scene import Gaussians, Vector

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

UNSEEN = 1.0 / 255.0
"""Opacities below change no pixel; `tsplat.rendering.ALPHA_MIN`, which drawing alone may change."""


def finish(
    path: Path,
    means: F32,
    quats: F32,
    scales: F32,
    opacities: F32,
    sh: F32,
    *,
    good: Mask | None = None,
    max_splats: int | None,
    antialiased: bool = False,
    up: Vector | None = None,
    origin: Vector | None = None,
    extra: Extra | None = None,
) -> Gaussians:
    """Return the scene of a file.

    Parameters
    ----------
    path : Path
        The file, for the warning.
    means, quats, scales, opacities, sh : ndarray of float32
        As in `tsplat.io.arrays.Arrays`; what they hold is changed, and they become the scene.
    good : ndarray of bool, [N], optional
        As from `mend`, where the reader knows or has mended the splats; else all are mended here.
    max_splats : int or None
        Keep at most this many, those with the largest opacity times area.
    antialiased, up, extra
        As in `Gaussians`.
    origin : tuple of 3 floats, optional
        As in `Gaussians`, where the reader has taken one off; else it is looked for here.

    Raises
    ------
    LoadError
        There are splats, but none that can be drawn.

    Warns
    -----
    LoadWarning
        Splats with nan, inf or a zero quat were left out.
    """
    arrays = Arrays(
        *(np.require(array, np.float32, ("C", "W")) for array in (means, quats, scales, opacities, sh))
    )
    count = len(means)
    if good is None:
        good = mend_all(arrays)
    kept = int(np.count_nonzero(good))
    if count and not kept:
        raise LoadError(path, f"none of its {count} splats can be drawn: {_reasons(arrays)}")
    warn_dropped(path, count - kept, count, stacklevel=5)
    if max_splats is not None and max_splats < kept:
        good = most_important(scores(arrays, good), max_splats)
    means, quats, scales, opacities, sh = (keep(array, good) for array in arrays)
    if origin is None and (origin := find_origin(means)):
        take_off(means, origin)
    about = {"antialiased": antialiased, "up": up, "origin": origin, "extra": extra}
    if extra and not good.all():
        about["extra"] = extra.take(np.flatnonzero(good))
    return Gaussians.of_finite(means, quats, scales, opacities, sh, **about)


def warn_dropped(path: Path, dropped: int, count: int, stacklevel: int) -> None:
    """Say how many splats of a file were left out, if any."""
    if dropped:
        problem = f"dropped {dropped} of {count} splats: nan, inf or a zero quat"
        warnings.warn(f"{path}: {problem}", LoadWarning, stacklevel=stacklevel)


def _reasons(arrays: Arrays) -> str:
    """Say how many splats cannot be drawn for each of the arrays, and what to do."""
    bad = {
        name: int(np.count_nonzero(~np.isfinite(array.reshape(len(array), -1)).all(axis=1)))
        for name, array in arrays._asdict().items()
    }
    zero = {"quats": "zero, nan or inf"}  # which became nan
    said = ", ".join(f"{bad[name]} for {zero.get(name, 'nan or inf')} in {name}" for name in bad if bad[name])
    alone = bad["scales"] and not any(bad[name] for name in bad if name != "scales")
    linear = ", or read a PLY with raw_scales if its scales are no logarithms" if alone else ""
    return f"{said}; export it again{linear}"


def warn_faint(path: Path, gaussians: Gaussians, stacklevel: int) -> None:
    """Say that no splat of a scene can be seen, if so: a black picture is no answer."""
    count = len(gaussians)
    if count and gaussians.opacities.max() < UNSEEN:
        problem = f"{count} of {count} splats are too faint to be seen, with opacities below 1/255"
        remedy = "open an earlier or later state of the training"
        warnings.warn(f"{path}: {problem}; {remedy}", LoadWarning, stacklevel=stacklevel)


def mend_all(arrays: Arrays) -> Mask:
    """Do what `mend` does, on several threads."""
    good = np.empty(len(arrays.means), np.bool_)

    def mend_chunk(rows: slice) -> None:
        good[rows] = mend(arrays.part(rows))

    on_threads(mend_chunk, chunks(len(good)))
    return good


def mend(arrays: Arrays) -> Mask:
    """Make quats unit quats in place, and mark the splats that can be drawn: no nan, no inf, no zero quat."""
    good = np.ones(len(arrays.means), np.bool_)
    with np.errstate(all="ignore"):  # what that makes is what is looked for
        for array in arrays:
            mark_finite(array, good)
        good &= make_unit(arrays.quats) > 0.0
    return good


def make_unit(quats: F32) -> F64:
    """Make quats unit quats in place, and return how long they were, float64 [N]; those of 0 become nan."""
    # Squares leave float32 soon.
    lengths: F64 = np.sqrt(np.einsum("ij,ij->i", quats, quats, dtype=np.float64))
    np.divide(quats, lengths[:, None], out=quats, casting="same_kind")
    return lengths


def mark_finite(array: F32, good: Mask) -> None:
    """Clear the marks of the rows of ``array`` that hold nan or inf."""
    # One pass where all is well: a nan or inf anywhere shows in the sum. An overflowing sum of
    # finite values only costs the exact test.
    if not math.isfinite(array.sum()):
        good &= np.isfinite(array.reshape(len(array), -1)).all(axis=1)


def scores(arrays: Arrays, good: Mask) -> F32:
    """Return what `most_important` chooses by: the importance of good splats, -1 for others."""
    found = np.full(len(good), -1.0, np.float32)
    for rows in chunks(len(good)):
        marks = good[rows]
        found[rows][marks] = importance(arrays.scales[rows][marks], arrays.opacities[rows][marks])
    return found


def keep(array: F32, good: Mask) -> F32:
    """Return the marked rows of ``array``, in its own memory where that is its own."""
    if good.all():
        return array
    kept = 0
    for rows in chunks(len(good)):
        chosen = array[rows][good[rows]]
        array[kept : kept + len(chosen)] = chosen
        kept += len(chosen)
    if kept < len(array) and not array.flags.owndata:
        return array[:kept].copy()
    array.resize((kept, *array.shape[1:]), refcheck=False)
    return array
