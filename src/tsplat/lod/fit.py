"""Scenes made fit to be merged, where float32 does not hold the squares of their sizes.

Splats beyond all measure are set apart, and the rest is brought to a size near 1, to the bit.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tsplat.framing import SAMPLE
from tsplat.scene import Gaussians

F64 = npt.NDArray[np.float64]

GIANT = 1e9
"""Times the median size and distance of splats: what is more is no part of what a scene shows."""

USUAL = 1e-6, 1e6
"""World units. Scenes of such a size are merged as they are."""

LARGEST = float(np.finfo(np.float32).max)


class Fit(NamedTuple):
    """A scene to be merged.

    Attributes
    ----------
    scene : Gaussians
        Without giants, in units of ``unit``.
    unit : float
        A power of two, in world units.
    giants : Gaussians
        Set apart, in world units.
    """

    scene: Gaussians
    unit: float
    giants: Gaussians

    def in_world(self, merged: Gaussians) -> Gaussians:
        """Return what was made of the scene in world units."""
        return merged if self.unit == 1.0 else _in_units(merged, 1.0 / self.unit)


def fit(gaussians: Gaussians) -> Fit:
    """Return a scene fit to be merged; one of at least one splat, and mostly just itself."""
    spans = _spans(gaussians)
    typical = float(np.median(spans)) or float(spans.max()) or 1.0
    near = spans <= GIANT * typical
    unit = 1.0 if USUAL[0] <= typical <= USUAL[1] else 2.0 ** round(math.log2(typical))
    some = gaussians if near.all() else gaussians.take(np.flatnonzero(near))
    scene = some if unit == 1.0 else _in_units(some, unit)
    return Fit(scene, unit, gaussians.take(np.flatnonzero(~near)))


def _spans(gaussians: Gaussians) -> F64:
    """Return how far each splat reaches from the middle along an axis, or how large it is if that is more."""
    middle = np.median(gaussians.means[:: 1 + len(gaussians) // SAMPLE].astype(np.float64), axis=0)
    distances = np.abs(gaussians.means - middle).max(axis=1)
    spans: F64 = np.maximum(distances, gaussians.scales.max(axis=1))
    return spans


def _in_units(gaussians: Gaussians, unit: float) -> Gaussians:
    means, scales = gaussians.means.astype(np.float64) / unit, gaussians.scales.astype(np.float64) / unit
    return replace(gaussians, means=np.clip(means, -LARGEST, LARGEST), scales=np.minimum(scales, LARGEST))
