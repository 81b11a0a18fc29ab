"""Whether a scene that may be upright or upside down is upside down: five weak cues that agree.

Each of them is wrong in a third of all scenes, a bright floor is enough; of SPZ alone so many are upside
down, their writer having kept the axes of a PLY, that their sum is worth listening to.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tsplat.camera import Vector
from tsplat.framing.bulk import Bulk
from tsplat.framing.sample import quantiles
from tsplat.framing.surface import Surface

F64 = npt.NDArray[np.float64]

GAIN, WEAKER_GAIN = 5.0, 3.0
"""A correlation of a fifth is as clear as a cue gets; of those that are wrong more often, one of a third."""

TURNED = 1.8
"""Of five, what cues must come to; see docs/first-view.md."""


def upside_down(seen: Surface, box: Bulk, up: Vector) -> float:
    """Return how much speaks against ``up`` being up, from -5 to 5; `TURNED` is enough."""
    if not (seen.flat.sum() > 0.0 and seen.solid.sum() > 0.0):
        return 0.0
    axis = np.array(up)
    offsets = seen.means - box.center
    heights = offsets @ axis
    # Outward, as far as a surface closes around the middle.
    outward = np.sign((seen.normals * offsets).sum(axis=1)) * (seen.normals @ axis)
    bottom, top = quantiles(heights, seen.solid, (0.02, 0.98))
    middle = float(np.average(heights, weights=seen.solid))
    cues = (
        GAIN * _correlation(seen.luminance, outward, seen.flat),  # light comes from above
        WEAKER_GAIN * _correlation(seen.luminance, heights, seen.solid),
        WEAKER_GAIN * float(np.average(outward, weights=seen.flat)),  # nobody photographs the underside
        GAIN * (0.5 * (bottom + top) - middle) / max(top - bottom, 1e-30),  # what is heavy lies low
        -GAIN * _correlation(np.log(np.maximum(seen.sizes, 1e-30)), heights, seen.solid),  # detail is at the top
    )
    return -sum(max(-1.0, min(1.0, cue)) for cue in cues)


def _correlation(left: F64, right: F64, weights: F64) -> float:
    left, right = (each - np.average(each, weights=weights) for each in (left, right))
    products = (left * right, left * left, right * right)
    both, *squares = (float(np.average(each, weights=weights)) for each in products)
    return both / max(float(np.sqrt(squares[0] * squares[1])), 1e-30)
