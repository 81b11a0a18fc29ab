"""How one value is spread over the splats of a scene: percentiles and a histogram, from one sort."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

F32 = npt.NDArray[np.float32]
Axis = Literal["unit", "linear", "log"]

PERCENTILES = (0, 1, 5, 25, 50, 75, 95, 99, 100)
"""Percent, lowest and highest value included."""

BINS = 24

LOG_RANGE = 1e-6
"""A logarithmic axis begins at this share of its end: a few zeros must not press the rest into one bin."""

LOG_MARGIN = 1.5
"""It reaches at least this factor to either side of its middle: values that are all alike stand in the middle."""


def distribution(values: F32, axis: Axis) -> dict[str, Any]:
    """Return how values are spread, as what `json.dumps` takes.

    Parameters
    ----------
    values : ndarray of float32, [N]
        One or more, finite, not negative.
    axis : {"unit", "linear", "log"}
        Of the histogram: from 0 to 1; from 0 to the 99th percentile; from the 1st to the 99th, in equal ratios.

    Returns
    -------
    dict
        ``percentiles``: percent as text to value, see `PERCENTILES`. ``histogram``: ``axis``, ``edges`` and
        ``counts``, one edge more than counts; the first bin takes all that is below, the last all that is above.
    """
    ordered = np.sort(values)
    percentiles = {str(percent): _percentile(ordered, percent) for percent in PERCENTILES}
    edges = _edges(percentiles, axis)
    inner = np.searchsorted(ordered, edges[1:-1])
    counts = np.diff(inner, prepend=0, append=len(ordered))
    edges[0], edges[-1] = min(edges[0], percentiles["0"]), max(edges[-1], percentiles["100"])
    return {
        "percentiles": percentiles,
        "histogram": {"axis": axis, "edges": edges.tolist(), "counts": counts.tolist()},
    }


def _percentile(ordered: F32, percent: int) -> float:
    place = 0.01 * percent * (len(ordered) - 1)
    below, above = float(ordered[math.floor(place)]), float(ordered[math.ceil(place)])
    return below + (above - below) * (place - math.floor(place))


def _edges(percentiles: dict[str, float], axis: Axis) -> npt.NDArray[np.float64]:
    if axis == "unit":
        return np.linspace(0.0, 1.0, BINS + 1)
    high = percentiles["99"] or percentiles["100"] or 1.0
    if axis == "linear":
        return np.linspace(0.0, high, BINS + 1)
    low = max(percentiles["1"], LOG_RANGE * high)
    middle = math.sqrt(low) * math.sqrt(high)
    return np.geomspace(min(low, middle / LOG_MARGIN), max(high, middle * LOG_MARGIN), BINS + 1)
