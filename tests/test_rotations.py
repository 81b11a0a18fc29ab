"""Quats and matrices stand for the same rotations."""

from __future__ import annotations

import numpy as np
import pytest

from tsplat.raster.reference import covariances
from tsplat.rotations import F64, quat_products, quats_of, rotations_of

HALF_TURNS = np.eye(4)
"""No turn, and half a turn about each axis, where the sum of the diagonal tells nothing."""


@pytest.fixture
def quats() -> F64:
    many = np.concatenate([np.random.default_rng(0).normal(size=(500, 4)), HALF_TURNS, HALF_TURNS + 1e-7])
    return np.asarray(many / np.linalg.norm(many, axis=1, keepdims=True))


def test_matrices_are_those_that_covariances_are_made_of(quats: F64) -> None:
    scales = np.array([0.5, 1.0, 2.0])
    stretched = rotations_of(quats) * scales
    np.testing.assert_allclose(
        stretched @ stretched.transpose(0, 2, 1), covariances(quats, np.tile(scales, (len(quats), 1))), atol=1e-12
    )


def test_a_quat_comes_back_from_its_matrix_but_for_its_sign(quats: F64) -> None:
    back = quats_of(rotations_of(quats))
    np.testing.assert_allclose(np.abs(np.einsum("ij,ij->i", back, quats)), 1.0, atol=1e-12)


def test_a_product_turns_by_the_right_one_first(quats: F64) -> None:
    left = quats[7]
    found = rotations_of(quat_products(left, quats))
    np.testing.assert_allclose(found, rotations_of(left[None])[0] @ rotations_of(quats), atol=1e-12)
