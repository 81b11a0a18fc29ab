"""The values of splats, by slow and obvious means."""

from __future__ import annotations

import math

import numpy as np

from tests.scenes import random_gaussians
from tsplat.framing import bulk
from tsplat.info.measures import Measures, measure
from tsplat.raster.reference import sh_basis
from tsplat.scene import Gaussians

SCENE = random_gaussians(np.random.default_rng(6), 200, 4)
BOX = bulk(SCENE)


def test_lengths_and_distances_are_those_of_each_splat() -> None:
    found = measure(SCENE, BOX)
    for splat in range(len(SCENE)):
        scales = sorted(SCENE.scales[splat])
        assert found.longest[splat] == scales[2]
        np.testing.assert_allclose(found.flatness[splat], scales[0] / scales[2], rtol=1e-6)
        distance = np.linalg.norm(SCENE.means[splat] - BOX.center) / BOX.radius
        np.testing.assert_allclose(found.distances[splat], distance, rtol=1e-6)


def test_colours_are_compared_with_those_seen_from_all_around() -> None:
    turns = np.arange(4000) + 0.5
    heights, angles = 1.0 - turns / 2000.0, turns * math.pi * (1.0 + math.sqrt(5.0))
    rings = np.sqrt(1.0 - heights**2)
    around = np.stack([rings * np.cos(angles), rings * np.sin(angles), heights], axis=1)
    seen = 0.5 + np.einsum("dk,nkc->ndc", sh_basis(around), SCENE.sh.astype(np.float64))
    found = measure(SCENE, BOX)
    np.testing.assert_allclose(found.colors, seen.mean(axis=1), atol=1e-3)
    assert found.view_dependence is not None
    np.testing.assert_allclose(found.view_dependence, seen.var(axis=1).mean(axis=1) ** 0.5, rtol=5e-3)


def test_without_harmonics_there_is_no_view_dependence() -> None:
    plain = random_gaussians(np.random.default_rng(6), 20, 0)
    assert measure(plain, bulk(plain)).view_dependence is None


def test_a_splat_without_extent_is_flat_and_no_division_by_zero() -> None:
    point = Gaussians(np.zeros((2, 3)), np.eye(4)[[0, 0]], np.zeros((2, 3)), np.ones(2), np.zeros((2, 1, 3)))
    assert measure(point, bulk(point)).flatness.tolist() == [0.0, 0.0]


def test_coefficients_whose_squares_no_float32_can_hold_are_told_apart() -> None:
    sh = np.zeros((2, 16, 3))
    sh[:, 1:] = np.array([1e20, 1e30])[:, None, None]
    bright = Gaussians(np.zeros((2, 3)), np.eye(4)[[0, 0]], np.ones((2, 3)), np.ones(2), sh)
    expected = np.sqrt(45.0 / (12.0 * math.pi)) * np.array([1e20, 1e30])
    np.testing.assert_allclose(measure(bright, bulk(bright)).view_dependence, expected, rtol=1e-5)


def test_values_of_the_largest_floats_stay_finite() -> None:
    most = float(np.finfo(np.float32).max)
    means = np.array([[most, most, most], [-most, -most, -most], [0, 0, 0]])
    giant = Gaussians(means, np.eye(4)[[0, 0, 0]], np.full((3, 3), most), np.ones(3), np.full((3, 16, 3), most))
    found = measure(giant, bulk(giant))
    for name in Measures.__slots__:
        assert np.isfinite(getattr(found, name)).all(), name
