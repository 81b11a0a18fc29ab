"""What can be said about a scene in numbers: for `tsplat info` and for the viewer's HUD."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from tsplat.camera import Vector
from tsplat.framing import bulk
from tsplat.scene import Gaussians

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]

PERCENTILES = (0, 1, 5, 25, 50, 75, 95, 99, 100)
"""Percent, lowest and highest value included."""


@dataclass(frozen=True, slots=True)
class Summary:
    """A scene in numbers; lengths are in world units.

    Attributes
    ----------
    count : int
        Splats.
    sh_degree : int
        Degree of the spherical harmonics stored, 0 to 3.
    low, high : tuple of 3 floats, or None
        Corners of the box around all centres, floaters included; None for an empty scene.
    bulk_center : tuple of 3 floats
        Middle of what the start view shows.
    bulk_radius : float
        Its extent.
    bulk_low, bulk_high : tuple of 3 floats
        Its corners.
    opacities : dict of int to float
        Opacity by percentile, see `PERCENTILES`; empty for an empty scene.
    scales : dict of int to float
        Longest standard deviation of each splat by percentile, likewise.
    nbytes : int
        Memory of the scene in bytes.
    """

    count: int
    sh_degree: int
    low: Vector | None
    high: Vector | None
    bulk_center: Vector
    bulk_radius: float
    bulk_low: Vector
    bulk_high: Vector
    opacities: dict[int, float]
    scales: dict[int, float]
    nbytes: int

    def as_dict(self) -> dict[str, Any]:
        """Return all fields, fit for JSON: lists instead of tuples, and texts as keys."""
        plain = asdict(self)
        for name, value in plain.items():
            if isinstance(value, tuple):
                plain[name] = list(value)
            elif isinstance(value, dict):
                plain[name] = {str(key): number for key, number in value.items()}
        return plain


def summarize(gaussians: Gaussians) -> Summary:
    """Return a scene in numbers.

    Parameters
    ----------
    gaussians : Gaussians
        Any scene, also an empty one.

    Returns
    -------
    Summary
        Every number finite.
    """
    box = bulk(gaussians)
    some = len(gaussians) > 0
    return Summary(
        count=len(gaussians),
        sh_degree=gaussians.sh_degree,
        low=_vector(gaussians.means.min(axis=0)) if some else None,
        high=_vector(gaussians.means.max(axis=0)) if some else None,
        bulk_center=_vector(box.center),
        bulk_radius=box.radius,
        bulk_low=_vector(box.low),
        bulk_high=_vector(box.high),
        opacities=_percentiles(gaussians.opacities),
        scales=_percentiles(gaussians.scales.max(axis=1)),
        nbytes=gaussians.nbytes,
    )


def _percentiles(values: F32) -> dict[int, float]:
    if not len(values):
        return {}
    return dict(zip(PERCENTILES, np.percentile(values, PERCENTILES).tolist(), strict=True))


def _vector(values: F32 | F64) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z
