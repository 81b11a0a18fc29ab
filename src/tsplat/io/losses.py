"""What a file lacks of the scene that it was written from, beyond the rounding of its format: told with numbers.

Splats far outside of the bulk are few, and would cost all others the bits of their places in formats that count
within bounds. Where nothing else helps they are brought nearer, and made smaller by as much: from the bulk, where
the eye is, they look as before.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tsplat.errors import SaveError, SaveWarning, printable
from tsplat.extra import Extra, described
from tsplat.framing import UP_DEFAULT, Bulk
from tsplat.importance import importance
from tsplat.io.arrays import chunks
from tsplat.io.ply_comments import matters
from tsplat.scene import SH_COEFFICIENTS, Gaussians

F64 = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

FINE = 1 / 2048
"""Radii of the bulk by which a sigma may change: a tenth of a pixel where the bulk fills a picture of 480 rows."""

FEW = 0.01
"""Of all splats: so few that are too large for a file are no reason to make everything smaller."""

SHOWN = 0.01
"""Root of the mean square by which colours may change, from 0 to 1: 40 dB."""


def warn_lost(path: Path, losses: Sequence[str], stacklevel: int) -> None:
    """Say what a file lacks."""
    for loss in losses:
        warnings.warn(f"{printable(str(path))}: {loss}", SaveWarning, stacklevel=stacklevel)


def refuse_lost(path: Path, losses: Sequence[str]) -> None:
    """Raise what keeps a file from being written that would lack something.

    Raises
    ------
    SaveError
        It would.
    """
    if losses:
        raise SaveError(f"{printable(str(path))}: {'; '.join(losses)}; nothing is written, as strict asks")


def counted(which: npt.ArrayLike, problem: str) -> list[str]:
    """Return one text that says how many splats have a problem; none where none has."""
    mask = np.asarray(which)
    count, total = int(np.count_nonzero(mask)), len(mask)
    return [f"{count:,} of {total:,} splats {problem}"] if count else []


def colors_cut(gaussians: Gaussians, which: slice, limit: float, what: str) -> list[str]:
    """Return what is lost where a file has only coefficients of colours from minus ``limit`` to ``limit``.

    Parameters
    ----------
    gaussians : Gaussians
        The scene.
    which : slice
        Coefficients.
    limit : float
        The largest that the file has.
    what : str
        What to call those beyond.
    """
    weights = importance(gaussians.scales, gaussians.opacities).astype(np.float64)
    if len(weights):
        weights = np.minimum(weights, np.quantile(weights, 0.95))  # a backdrop is a few huge splats
    count, shown = 0, 0.0
    for part in chunks(len(weights)):
        excess = np.maximum(np.abs(gaussians.sh[part, which], dtype=np.float64) - limit, 0.0)
        # The harmonics are orthonormal: the mean square over the sphere is the sum of squares over its area.
        squares = np.square(excess).sum(axis=(1, 2)) / (3.0 * 4.0 * np.pi)
        count += int(np.count_nonzero(squares))
        shown += float(np.minimum(squares, 1.0) @ weights[part])
    if shown <= SHOWN**2 * weights.sum():
        return []
    return [f"{count:,} of {len(weights):,} splats have {what}, and were cut to that"]


def sigmas_cut(gaussians: Gaussians, box: Bulk, least: float, most: float) -> list[str]:
    """Return what is lost where a file has only sigmas from ``least`` to ``most``.

    Thin splats may become a little thicker, as long as that is nothing beside the bulk.
    """
    changes = np.abs(np.clip(gaussians.scales, least, most) - gaussians.scales.astype(np.float64)).max(axis=1)
    wrong = changes > FINE * box.radius
    longest = float(gaussians.scales[wrong].max(initial=0.0))
    if longest > most and wrong.mean() < FEW:
        remedy = f"--max-scale {most:.6g} removes them"
    elif longest > most:
        remedy = f"--scale {10.0 ** math.floor(math.log10(most / longest)):g} keeps them"
    else:
        remedy = f"--scale {10.0 ** math.ceil(math.log10(least / FINE / box.radius)):g} keeps them"
    return counted(wrong, f"have a sigma outside of {least:.3g} to {most:.3g}, and were cut to that; {remedy}")


def too_far(gaussians: Gaussians, low: F64, high: F64) -> Mask:
    """Return which centres lie outside of a box."""
    return np.asarray(((gaussians.means < low) | (gaussians.means > high)).any(axis=1))


def brought_nearer(gaussians: Gaussians, box: Bulk, low: F64, high: F64) -> Gaussians:
    """Return the scene with the splats outside of a box, which holds the bulk, moved to its faces.

    They go towards the middle of the bulk and shrink by as much, so that they look the same from there.
    """
    far = np.flatnonzero(too_far(gaussians, low, high))
    offsets = gaussians.means[far].astype(np.float64) - box.center
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(offsets > 0.0, (high - box.center) / offsets, (low - box.center) / offsets)
    shares = np.where(offsets == 0.0, 1.0, room).min(axis=1, initial=1.0)[:, None]
    means, scales = gaussians.means.copy(), gaussians.scales.copy()
    means[far] = np.clip(box.center + shares * offsets, low, high)
    scales[far] = scales[far] * shares
    return replace(gaussians, means=means, scales=scales)


def lacks(gaussians: Gaussians, sh_degree: int, keeps: Collection[str]) -> list[str]:
    """Return what a format has no place for.

    Parameters
    ----------
    gaussians : Gaussians
        The scene.
    sh_degree : int
        The highest that the format has.
    keeps : collection of str
        Which of origin, up, antialiased, comments and extra it has a place for.
    """
    problems = []
    if gaussians.sh[:, SH_COEFFICIENTS[sh_degree] :].any():
        beyond = f"above degree {sh_degree}" if sh_degree else "that change with the view"
        problems.append(f"colours {beyond} are left out" if not sh_degree else f"harmonics {beyond} are left out")
    if gaussians.origin and "origin" not in keeps:
        where = ", ".join(map(repr, gaussians.origin))
        problems.append(
            f"the origin ({where}) is left out: the file's coordinates begin there; .ply and .glb keep it"
        )
    if gaussians.up not in (None, UP_DEFAULT) and "up" not in keeps:
        said = ", ".join(f"{value:.4g}" for value in gaussians.up or ())
        problems.append(
            f"that ({said}) is up is left out; .ply keeps it, and --rotate can turn -y up, as most expect"
        )
    if gaussians.antialiased and "antialiased" not in keeps:
        problems.append("that it was trained with antialiasing is left out")
    return problems + (_left_behind(gaussians.extra, "comments" in keeps) if "extra" not in keeps else [])


def _left_behind(extra: Extra | None, comments: bool) -> list[str]:
    if extra is None:
        return []
    left = [described(extra.names, "column")] if extra.names else []
    left += [described([table.name for table in extra.tables], "element")] if extra.tables else []
    count = 0 if comments else sum(map(matters, extra.comments))
    left += [f"{count} comment{'s' if count > 1 else ''}"] if count else []
    return [*extra.lost, *([f"{', '.join(left)} left out; .ply keeps them"] if left else [])]
