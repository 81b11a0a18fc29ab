"""Colours turned with their splats: spherical harmonics under rotations and mirrors, degree by degree.

The harmonics of one degree only mix among themselves, by a matrix that is solved for from enough directions.

Source: Sloan 2013, *Efficient Spherical Harmonic Evaluation*, for the basis; its order and signs are gsplat's.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]

DIRECTIONS = 64
"""More than twice the harmonics of degree 4, and evenly spread: the solution is exact to rounding."""

DECIMALS = 12
"""What float32 cannot see is rounded away, so that quarter and half turns only move numbers and change signs."""

CHUNK = 1 << 14
"""Splats turned at a time: a few megabytes, whatever the scene."""


def rotate_sh(sh: npt.ArrayLike, rotation: npt.ArrayLike) -> F32:
    """Return harmonics that show, along a rotated direction, what ``sh`` shows along the direction itself.

    Parameters
    ----------
    sh : ndarray of float32, [N, K, 3]
        As in `Gaussians`; K is the square of a whole number.
    rotation : ndarray of float, [3, 3]
        Orthogonal: a rotation, or one with a mirror.

    Returns
    -------
    ndarray of float32, [N, K, 3]
        A new array.
    """
    source = np.asarray(sh, np.float32)
    count, k, channels = source.shape
    turn = np.kron(sh_rotation(rotation, math.isqrt(k) - 1), np.eye(channels)).T.astype(np.float32)
    turned = np.empty_like(source)
    with np.errstate(over="ignore", invalid="ignore"):  # broken splats are for the caller to find
        for first in range(0, count, CHUNK):
            part = source[first : first + CHUNK]
            turned[first : first + CHUNK] = (part.reshape(len(part), -1) @ turn).reshape(part.shape)
    return turned


def sh_rotation(rotation: npt.ArrayLike, degree: int) -> F64:
    """Return the matrix from coefficients to turned ones, [K, K], a block for each degree up to ``degree``."""
    directions = _spread()
    basis = sh_basis(directions, degree)
    before = sh_basis(directions @ np.asarray(rotation, np.float64), degree)
    matrix = np.zeros((basis.shape[1],) * 2)
    for each in range(degree + 1):
        block = slice(each**2, (each + 1) ** 2)
        matrix[block, block] = np.linalg.pinv(basis[:, block]) @ before[:, block]
    return matrix.round(DECIMALS)


def sh_basis(directions: npt.ArrayLike, degree: int) -> F64:
    """Return the real spherical harmonics of unit directions up to any degree, [N, (degree + 1)^2].

    Each is a polynomial in z times the real or the imaginary part of (-x - iy)^m.
    """
    x, y, z = np.asarray(directions, np.float64).T
    columns: dict[tuple[int, int], F64] = {}
    for m in range(degree + 1):
        around = (-x - 1j * y) ** m
        before, polynomial = np.zeros_like(z), np.full_like(z, math.prod(range(1, 2 * m, 2)))
        for n in range(m, degree + 1):
            size = math.sqrt((2 * n + 1) / (4 * math.pi) * math.factorial(n - m) / math.factorial(n + m))
            scaled = size * math.sqrt(2.0 if m else 1.0) * polynomial
            columns[n, -m], columns[n, m] = scaled * around.imag, scaled * around.real
            # The recursion of the associated Legendre polynomials, their factor of (1 - z^2)^(m/2) left out.
            following = ((2 * n + 1) * z * polynomial - (n + m) * before) / (n + 1 - m)
            before, polynomial = polynomial, following
    return np.stack([columns[n, m] for n in range(degree + 1) for m in range(-n, n + 1)], axis=1)


def _spread() -> F64:
    turns = np.arange(DIRECTIONS) * math.pi * (3.0 - math.sqrt(5.0))
    z = (np.arange(DIRECTIONS) + 0.5) * 2.0 / DIRECTIONS - 1.0
    radius = np.sqrt(1.0 - z * z)
    return np.stack([radius * np.cos(turns), radius * np.sin(turns), z], axis=1)
