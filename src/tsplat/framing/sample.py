"""Some splats of a scene, what each of them counts, and quantiles of what they hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tsplat.importance import area
from tsplat.scene import Gaussians

F64 = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

SAMPLE = 8192
"""Splats looked at: quantiles of this many are steady to a percent and take milliseconds."""


@dataclass(frozen=True, eq=False, slots=True)
class Sample:
    """M splats.

    Attributes
    ----------
    means : ndarray of float64, [M, 3]
        Centres in world units.
    sizes : ndarray of float64, [M]
        Edges of squares that throw as large a shadow, in world units.
    weights : ndarray of float64, [M]
        What each counts: opacity times area, not all 0.
    opacities : ndarray of float64, [M]
        In [0, 1].
    """

    means: F64
    sizes: F64
    weights: F64
    opacities: F64

    def only(self, keep: Mask) -> Sample:
        """Return those splats that are marked, [M]."""
        return Sample(self.means[keep], self.sizes[keep], self.weights[keep], self.opacities[keep])


def step_of(gaussians: Gaussians) -> int:
    """Return every how many splats one is looked at."""
    return 1 + len(gaussians) // SAMPLE


def sample(gaussians: Gaussians) -> Sample:
    """Return splats evenly spread over the file, with their weights."""
    step = step_of(gaussians)
    areas = area(gaussians.scales[::step])
    opacities = gaussians.opacities[::step].astype(np.float64)
    weights = opacities.copy()
    if len(areas):
        # Beyond the median a larger splat counts no more: backdrops are few and huge.
        weights *= np.minimum(areas, np.median(areas))
    if not weights.sum() > 0.0:
        weights = np.ones(len(areas))
    return Sample(gaussians.means[::step].astype(np.float64), np.sqrt(areas), weights, opacities)


def quantile(values: F64, weights: F64, share: float) -> float:
    """Return the value that this share of the weight lies below; there is at least one value."""
    return quantiles(values, weights, (share,))[0]


def quantiles(values: F64, weights: F64, shares: Sequence[float]) -> list[float]:
    """Return the values that these shares of the weight lie below."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    places = np.searchsorted(total, np.multiply(shares, total[-1]))
    return [float(value) for value in values[order[np.minimum(places, len(order) - 1)]]]
