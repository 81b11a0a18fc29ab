"""Merging and hiding as the formulas have them, in plain float64: slow and obvious."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from tsplat.camera import Camera
from tsplat.scene import SH_C0

F64 = npt.NDArray[np.float64]


def full(upper: npt.ArrayLike) -> F64:
    """Return symmetric matrices [..., 3, 3] of their upper triangles [..., 6]."""
    return np.asarray(upper, np.float64)[..., [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(*np.shape(upper)[:-1], 3, 3)


def area(covar: F64) -> float:
    """Return the root mean square of the shadows along the principal axes, in units of pi."""
    a, b, c = np.maximum(np.linalg.eigvalsh(covar), 0.0)
    return math.sqrt((a * b + b * c + c * a) / 3.0)


def moments(masses: F64, means: F64, covars: F64) -> tuple[float, F64, F64]:
    """Return mass, mean and covariance of a mixture of Gaussians."""
    mass = float(masses.sum())
    mean = masses @ means / mass
    apart = means - mean
    spread = covars + np.einsum("ni,nj->nij", apart, apart)
    return mass, mean, np.einsum("n,nij->ij", masses, spread) / mass


def overlap(covar: F64, d: F64) -> float:
    """Return the density at d of a Gaussian, but for (2 pi)^(-3/2)."""
    return math.exp(-0.5 * d @ np.linalg.solve(covar, d)) / math.sqrt(np.linalg.det(covar))


def cost(first: dict[str, Any], second: dict[str, Any]) -> float:
    """Return what merging two splats changes; lengths in units of the typical size, so blurred by one of it."""
    masses = np.array([first["mass"], second["mass"]])
    means, covars = (np.stack([first[name], second[name]]) for name in ("mean", "covar"))
    mass, mean, covar = moments(masses, means, covars)
    signed = [*masses, -mass]
    all_means, all_covars = [*means, mean], [*covars, covar]
    difference = sum(
        signed[i] * signed[j] * overlap(all_covars[i] + all_covars[j] + np.eye(3), all_means[i] - all_means[j])
        for i in range(3)
        for j in range(3)
    )
    apart = SH_C0 * (first["color"] - second["color"])
    return float(difference + 0.5 * apart @ apart * masses.prod() * overlap(2 * covar + np.eye(3), np.zeros(3)))


def light(balls: F64, solidities: F64, camera: Camera, cells: int) -> F64:
    """Return what `tsplat.lod.occlusion.fill_light` does, for blocks with these middles and radii."""
    middles = balls[:, :3] @ camera.viewmat[:3, :3].T.astype(np.float64) + camera.viewmat[:3, 3]
    half_sides = balls[:, 3] / math.sqrt(3.0)
    scale = np.array([camera.K[0, 0], camera.K[1, 1]]) * cells / (camera.width, camera.height)
    shift = camera.K[:2, 2] * cells / (camera.width, camera.height)
    found, left = np.ones(len(balls)), np.ones((cells, cells))
    for i in np.argsort(middles[:, 2]):
        x, y, z = middles[i]
        if z <= half_sides[i]:
            continue
        ends = shift + scale * (np.array([[x, y]]) + half_sides[i] * np.array([[-1], [1]])) / z
        columns, rows = (_covered(start, end, cells) for start, end in ends.T)
        covered = np.outer(rows, columns)
        if covered.sum() > 0.0:
            found[i] = (covered * left**2).sum() / covered.sum()
        left *= 1.0 - covered * solidities[i]
    return found


def _covered(start: float, end: float, cells: int) -> F64:
    """Return how much of each cell of a row lies between two places."""
    return np.array([max(0.0, min(end, cell + 1) - max(start, cell)) for cell in range(cells)])
