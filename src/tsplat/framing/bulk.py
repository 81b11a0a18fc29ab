"""The bulk: the part of a scene that holds nearly all of its detail."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tsplat.framing.sample import Sample, quantile
from tsplat.framing.trim import trimmed_sample
from tsplat.scene import Gaussians

F64 = npt.NDArray[np.float64]

RESOLVED = 1e-6
"""Of the distance from the origin: what lies in less room than that is one point to float32."""

TAIL = 0.01
"""Share of the weight left out at either end of an axis."""


@dataclass(frozen=True, eq=False, slots=True)
class Bulk:
    """The part of a scene that holds nearly all of its detail.

    Attributes
    ----------
    center : ndarray of float64, [3]
        Middle of the box in world units.
    radius : float
        Of the ball about ``center`` that holds the bulk, in world units, positive.
    low, high : ndarray of float64, [3]
        Corners of the box in world units.
    """

    center: F64
    radius: float
    low: F64
    high: F64


def bulk(gaussians: Gaussians) -> Bulk:
    """Return where the scene is, floaters and backdrop left out.

    Parameters
    ----------
    gaussians : Gaussians
        Any scene; an empty one has its bulk around the origin.

    Returns
    -------
    Bulk
        The same for the same scene.
    """
    return bounds(trimmed_sample(gaussians))


def bounds(inner: Sample) -> Bulk:
    """Return the bulk that holds a trimmed sample."""
    if not len(inner.means):
        return Bulk(np.zeros(3), 1.0, -np.ones(3), np.ones(3))
    low = np.array([quantile(column, inner.weights, TAIL) for column in inner.means.T])
    high = np.array([quantile(column, inner.weights, 1.0 - TAIL) for column in inner.means.T])
    center = 0.5 * (low + high)
    radius = quantile(np.linalg.norm(inner.means - center, axis=1), inner.weights, 1.0 - TAIL)
    # One splat, or many in one place, are as large as they are drawn.
    size = 3.0 * quantile(inner.sizes, inner.weights, 0.5)
    resolved = RESOLVED * float(np.linalg.norm(center))
    return Bulk(center, max(radius, size, resolved) or 1e-4, low, high)
