"""What looks wrong in a scene: how many splats, what share of it, and what to do.

The thresholds lie outside of what trained scenes hold. The extremes named here are those of eight captures and of
coarser levels of one: a robot, a plant and cards without surroundings, a snow figure after 1000 and 3000 steps,
and a camera with a backdrop, whose splats are the flattest, hugest and farthest of all.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tsplat.info.measures import Measures
from tsplat.rendering import ALPHA_MIN

FLAT = 1e-7
"""Shortest over longest axis: about the step of float32, so that the thickness is lost beside the length. The
camera holds 1.4e-7, and 9 % of it lies below 1e-4: such splats are common and no fault."""

FLAT_SHARE = 0.001
"""Share of flat splats from which on it is worth a word; 2DGS and other writers make all of them so."""

HUGE, HUGE_OPACITY = 10.0, 0.02
"""Longest standard deviation in radii of the bulk, and the opacity from which on such a splat is seen as a veil.
The largest of the camera's backdrop has 6.2 radii."""

FAR = 100.0
"""Distance in radii of the bulk. The farthest splat of the camera's backdrop lies at 7.1; skies of outdoor
captures may lie ten times as far."""

TRANSPARENT_SHARE = 0.01
"""Share of splats below the alpha that is drawn at all; the plant holds 0.004."""

COLORS, COLORS_SHARE = (-1.0, 2.0), 0.01
"""Range of a splat's mean colour, and the share of splats beyond from which on it is no accident. The coarse
levels of the robot hold 0.002. The range from 0 to 1 itself is left by a tenth of all colours in many scenes."""

RAW_OPACITIES = (0.5 - 1 / 255, 1.0 / (1.0 + math.exp(-1.0)) + 1 / 255)
"""What 0 to 1 becomes when it is read as logits, give or take a byte's rounding."""

FAINT = 0.02
"""Training resets opacities to 0.01 at most, now and then; what it saved just after that has none above."""

LINEAR_MIN, LINEAR_GAPS, LINEAR_LOGS = 0.999, 1.3, (0.1, 5.0)
"""The exp of a length is 1 or more, give or take a format's rounding. It is longer than splats are apart, which
for N of them on surfaces is about the width of the scene over the root of N, and its logarithm is about as long as
that. Trained splats are 0.5 to 4 times as long, but never are all of them 1 thick in such a scene."""

ENOUGH = 10
"""Fewer splats say nothing by all having such an opacity or size."""

LOADING_REMEDY = "the rest is shown; train or convert the scene again if many are missing"


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that looks wrong.

    Attributes
    ----------
    kind : str
        For programs: loading, raw_scales, raw_opacity, hard_opacity, reset_opacity, colors, huge, far,
        transparent, flat, axes.
    text : str
        What, of how many splats.
    remedy : str
        What to do about it.
    count : int, optional
        Splats it is about; None where the reader did not say.
    share : float, optional
        The same as a share of all splats, from 0 to 1.
    """

    kind: str
    text: str
    remedy: str
    count: int | None
    share: float | None


def findings(
    measures: Measures, radius: float, *, raw_opacity: bool = False, raw_scales: bool = False
) -> list[Finding]:
    """Return what looks wrong in a scene, the worst first.

    Parameters
    ----------
    measures : Measures
        Of all splats.
    radius : float
        Of the bulk, in world units.
    raw_opacity, raw_scales : bool
        The file was read with these options.
    """
    every = [
        None if raw_scales else _raw_scales(measures, radius),
        _raw_opacities(measures, raw_opacity),
        _hard_opacities(measures, raw_opacity),
        _reset_opacities(measures),
        _colors(measures),
        _huge(measures, radius),
        _far(measures),
        _transparent(measures),
        _flat(measures),
    ]
    return [finding for finding in every if finding]


def finding_of_loading(problem: str) -> Finding:
    """Return what a reader warned of: counts are taken from its words, N of M, where it says any."""
    text, _, remedy = problem.partition("; ")
    said = re.search(r"\b(\d+) of (\d+)\b", text)
    count, total = map(int, said.groups()) if said else (None, None)
    share = count / total if count is not None and total else None
    return Finding("loading", text, remedy or LOADING_REMEDY, count, share)


def finding_of_axes() -> Finding:
    """Return that an SPZ is upside down, as those are whose writer kept the axes of a PLY."""
    text, remedy = "the scene is upside down for an SPZ", "it is shown turned; --spz-frame rdf reads it upright"
    return Finding("axes", text, remedy, None, None)


def _raw_scales(measures: Measures, radius: float) -> Finding | None:
    count = len(measures.longest)
    if count < ENOUGH or float((measures.longest * measures.flatness).min()) < LINEAR_MIN:
        return None
    usual = float(np.median(measures.longest))
    # Not the radius itself: it counts the sizes in.
    gap = 2.0 * max(float(np.median(measures.distances)) * radius, 1e-30) / math.sqrt(count)
    low, high = LINEAR_LOGS
    if usual < LINEAR_GAPS * gap or not low * gap <= math.log(usual) <= high * gap:
        return None
    return _found(
        "raw_scales",
        np.ones(count, bool),
        "are at least 1 unit thick, and too large for each other, as scales without the logarithm would be",
        "try --raw-scales with a PLY or .npz; what was converted from a PLY, convert again with raw scales",
    )


def _raw_opacities(measures: Measures, raw_opacity: bool) -> Finding | None:
    low, high = RAW_OPACITIES
    opacities = measures.opacities
    if raw_opacity or len(opacities) < ENOUGH or opacities.min() < low or opacities.max() > high:
        return None
    return _found(
        "raw_opacity",
        np.ones(len(opacities), bool),
        "have opacities from 0.5 to 0.73, as logits from 0 to 1 would give",
        "try --raw-opacity with a PLY or .npz; what was converted from a PLY, convert again with raw opacities",
    )


def _hard_opacities(measures: Measures, raw_opacity: bool) -> Finding | None:
    hard = (measures.opacities == 0.0) | (measures.opacities == 1.0)
    if len(hard) < ENOUGH or not hard.all():
        return None
    remedy = (
        "leave --raw-opacity out: the file seems to hold logits"
        if raw_opacity
        else "fine for a point cloud; else its opacities have another unit: convert the scene again"
    )
    return _found("hard_opacity", hard, "have an opacity of exactly 0 or 1", remedy)


def _reset_opacities(measures: Measures) -> Finding | None:
    faint = measures.opacities < FAINT
    if len(faint) < ENOUGH or not faint.all() or not measures.opacities.any():
        return None
    return _found(
        "reset_opacity",
        faint,
        f"have an opacity below {FAINT:g}: the scene was saved just after training reset them",
        "open what was saved some thousand steps later",
    )


def _colors(measures: Measures) -> Finding | None:
    low, high = COLORS
    red, green, blue = ((column < low) | (column > high) for column in measures.colors.T)
    return _found(
        "colors",
        red | green | blue,
        f"have a mean colour beyond {low:g} to {high:g}, where 0 to 1 is meant",
        "bytes or other units taken for coefficients look like this: convert the scene again",
        COLORS_SHARE,
    )


def _huge(measures: Measures, radius: float) -> Finding | None:
    return _found(
        "huge",
        (measures.longest > np.float64(HUGE * radius)) & (measures.opacities >= HUGE_OPACITY),
        f"are huge: a standard deviation of more than {HUGE:g} radii of the bulk",
        "they veil the view and take time: crop or prune the scene",
    )


def _far(measures: Measures) -> Finding | None:
    return _found(
        "far",
        measures.distances > FAR,
        f"are far away: more than {FAR:g} radii from the middle of the bulk",
        "harmless here, but formats of few bits lose detail in so wide a box: crop before converting",
    )


def _transparent(measures: Measures) -> Finding | None:
    return _found(
        "transparent",
        measures.opacities < ALPHA_MIN,
        "are never drawn: their opacity is below 1/255",
        "prune them, or keep the weightiest with --max-splats",
        TRANSPARENT_SHARE,
    )


def _flat(measures: Measures) -> Finding | None:
    return _found(
        "flat",
        measures.flatness < FLAT,
        f"are flat: their thickness is 0 or below {FLAT:g} of their length",
        "harmless here, but programs that take a scale's logarithm or inverse may fail: give them a thickness",
        FLAT_SHARE,
    )


def _found(
    kind: str, which: npt.NDArray[np.bool_], problem: str, remedy: str, at_least: float = 0.0
) -> Finding | None:
    count, total = int(np.count_nonzero(which)), len(which)
    if not count or count < at_least * total:
        return None
    text = f"{count:,} of {total:,} splats ({100.0 * count / total:.3g} %) {problem}"
    return Finding(kind, text, remedy, count, count / total)
