"""Quats and rotation matrices, one from the other; quats are ``wxyz``."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]


def quats_of(rotations: F64) -> F64:
    """Return unit quats [N, 4] of rotations [N, 3, 3]."""
    (a, b, c), (d, e, f), (g, h, i) = rotations.transpose(1, 2, 0)
    # Four times the outer product of the quat with itself: its longest row is the most exact.
    outer = np.array(
        [
            [1 + a + e + i, h - f, c - g, d - b],
            [h - f, 1 + a - e - i, b + d, c + g],
            [c - g, b + d, 1 - a + e - i, f + h],
            [d - b, c + g, f + h, 1 - a - e + i],
        ]
    )
    longest = np.einsum("iin->in", outer).argmax(axis=0)
    rows = outer[longest, :, np.arange(len(longest))]
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


def rotations_of(quats: npt.NDArray[np.floating]) -> F64:
    """Return rotations [N, 3, 3] of quats [N, 4] of length 1."""
    w, x, y, z = np.asarray(quats, np.float64).T
    zero = np.zeros_like(w)
    cross = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
    return np.asarray(np.eye(3) + 2.0 * (w[:, None, None] * cross + cross @ cross))


def quat_products(left: F64, rights: npt.NDArray[np.floating]) -> F64:
    """Return the quats [N, 4] of first turning by each of ``rights``, then by ``left``."""
    w, x, y, z = left
    by_left = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
    return np.asarray(rights @ by_left.T)
