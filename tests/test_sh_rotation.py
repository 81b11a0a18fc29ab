"""Turned harmonics against the basis that the renderer evaluates, and against degree 4 written out."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest

from tsplat import sh_rotation as module
from tsplat.raster import reference
from tsplat.sh_rotation import rotate_sh, sh_basis, sh_rotation

F64 = npt.NDArray[np.float64]


def some_directions(count: int = 40, seed: int = 0) -> F64:
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return np.asarray(directions)


def some_rotation(seed: int) -> F64:
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return np.asarray(q * np.linalg.det(q))


def some_sh(degree: int, count: int = 7) -> npt.NDArray[np.float32]:
    return np.random.default_rng(degree).normal(size=(count, (degree + 1) ** 2, 3)).astype(np.float32)


def degree_4(directions: F64) -> F64:
    x, y, z = directions.T
    xx, yy, zz = x * x, y * y, z * z
    return np.stack(
        [
            3 / 4 * math.sqrt(35 / math.pi) * x * y * (xx - yy),
            -3 / 4 * math.sqrt(35 / (2 * math.pi)) * y * z * (3 * xx - yy),
            3 / 4 * math.sqrt(5 / math.pi) * x * y * (7 * zz - 1),
            -3 / 4 * math.sqrt(5 / (2 * math.pi)) * y * z * (7 * zz - 3),
            3 / 16 * math.sqrt(1 / math.pi) * (35 * zz * zz - 30 * zz + 3),
            -3 / 4 * math.sqrt(5 / (2 * math.pi)) * x * z * (7 * zz - 3),
            3 / 8 * math.sqrt(5 / math.pi) * (xx - yy) * (7 * zz - 1),
            -3 / 4 * math.sqrt(35 / (2 * math.pi)) * x * z * (xx - 3 * yy),
            3 / 16 * math.sqrt(35 / math.pi) * (xx * (xx - 3 * yy) - yy * (3 * xx - yy)),
        ],
        axis=1,
    )


def test_the_basis_is_the_renderers_and_goes_on_as_the_textbook_does() -> None:
    directions = some_directions()
    basis, drawn = sh_basis(directions, 4), reference.sh_basis(directions)
    np.testing.assert_allclose(basis[:, : drawn.shape[1]], drawn, atol=1e-14)
    np.testing.assert_allclose(basis[:, 16:], degree_4(directions), atol=1e-14)


@pytest.mark.parametrize("degree", range(5))
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_a_turned_colour_looks_from_a_turned_direction_as_it_did(degree: int, seed: int, mirror: float) -> None:
    rotation = some_rotation(seed) * [1.0, 1.0, mirror]
    sh, directions = some_sh(degree), some_directions(seed=seed)
    before = np.einsum("dk,nkc->ndc", sh_basis(directions, degree), sh)
    after = np.einsum("dk,nkc->ndc", sh_basis(directions @ rotation.T, degree), rotate_sh(sh, rotation))
    np.testing.assert_allclose(after, before, atol=4e-6)
    assert degree == 0 or np.abs(rotate_sh(sh, rotation) - sh).max() > 0.1


def test_turning_twice_is_turning_by_the_product() -> None:
    first, second, sh = some_rotation(1), some_rotation(2), some_sh(4)
    twice = rotate_sh(rotate_sh(sh, first), second)
    np.testing.assert_allclose(twice, rotate_sh(sh, second @ first), atol=4e-6)


def test_the_matrix_is_orthogonal_and_keeps_degrees_apart() -> None:
    matrix = sh_rotation(some_rotation(3), 4)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(25), atol=1e-11)
    degrees = np.repeat(np.arange(5), 2 * np.arange(5) + 1)
    assert not matrix[degrees[:, None] != degrees].any()


def test_half_turns_only_change_signs_and_no_turn_changes_nothing() -> None:
    sh = some_sh(4)
    np.testing.assert_array_equal(rotate_sh(sh, np.eye(3)), sh)
    half = np.diag([-1.0, -1.0, 1.0])
    np.testing.assert_array_equal(np.abs(rotate_sh(sh, half)), np.abs(sh))
    np.testing.assert_array_equal(rotate_sh(rotate_sh(sh, half), half), sh)


def test_chunks_join_without_a_seam_and_none_is_no_chunk(monkeypatch: pytest.MonkeyPatch) -> None:
    sh, rotation = some_sh(3, 10), some_rotation(4)
    whole = rotate_sh(sh, rotation)
    monkeypatch.setattr(module, "CHUNK", 3)
    np.testing.assert_allclose(rotate_sh(sh, rotation), whole, atol=1e-6)
    assert rotate_sh(sh[:0], rotation).shape == (0, 16, 3)
