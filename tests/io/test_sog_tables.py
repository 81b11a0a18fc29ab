"""Codebooks and palettes of SOG: against the best there is, found slowly, and against plain k-means."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from tsplat.io.sog_codebook import fit_codebook, nearest_levels
from tsplat.io.sog_palette import fit_palette


def least_error(values: np.ndarray, weights: np.ndarray, levels: int) -> float:
    """Return the weighted sum of squares for the best levels, of all ways to divide the sorted values."""
    order = np.argsort(values)
    x, w = values[order].astype(np.float64), weights[order].astype(np.float64)
    sums = [np.concatenate([[0.0], np.cumsum(w * x**power)]) for power in range(3)]
    first, end = np.meshgrid(np.arange(len(x)), np.arange(1, len(x) + 1), indexing="ij")
    mass, moment, square = (each[end] - each[first] for each in sums)
    with np.errstate(divide="ignore", invalid="ignore"):
        cost = np.where(end > first, square - moment**2 / mass, np.inf)
    best = cost[0]
    for _ in range(levels - 1):
        best = np.minimum(best, np.concatenate([[np.inf], (best[:-1, None] + cost[1:]).min(axis=0)[1:]]))
    return float(best[-1])


def error(points: np.ndarray, found: np.ndarray, weights: np.ndarray) -> float:
    squares = np.square(points.astype(np.float64) - found)
    return float(np.sum(squares * weights) if squares.ndim == 1 else squares.sum(axis=1) @ weights)


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("shape", ["normal", "uniform", "heavy"])
def test_a_codebook_is_nearly_the_best(rng: np.random.Generator, shape: str, weighted: bool) -> None:
    values = {"normal": rng.normal(size=900), "uniform": rng.random(900), "heavy": rng.standard_cauchy(900)}[shape]
    values = values.astype(np.float32)
    weights = rng.uniform(0.1, 3, 900).astype(np.float32) if weighted else np.ones(900, np.float32)
    codebook = fit_codebook(values, weights if weighted else None)
    found = codebook[nearest_levels(values, codebook)]
    assert error(values, found, weights) < 1.06 * least_error(values, weights, 256)


def test_a_value_gets_the_nearest_level(rng: np.random.Generator) -> None:
    values = rng.normal(size=(500, 3)).astype(np.float32)
    codebook = fit_codebook(values)
    assert (codebook.shape, codebook.dtype) == ((256,), np.float32)
    assert np.all(np.diff(codebook) >= 0)
    nearest = np.abs(values[..., None] - codebook).min(axis=2)
    chosen = np.abs(values - codebook[nearest_levels(values, codebook)])
    np.testing.assert_allclose(chosen, nearest, atol=1e-7)


@pytest.mark.parametrize("count", [0, 1, 2, 256])
def test_few_values_are_their_own_codebook(rng: np.random.Generator, count: int) -> None:
    values = np.repeat(rng.normal(size=count).astype(np.float32) * 1e30, 3)
    codebook = fit_codebook(values)
    np.testing.assert_array_equal(codebook[nearest_levels(values, codebook)], values)
    assert np.isfinite(codebook).all()


def plain_k_means(points: np.ndarray, weights: np.ndarray, k: int, rng: np.random.Generator) -> np.ndarray:
    centres = points[rng.choice(len(points), k, replace=False)].astype(np.float64)
    for _ in range(6):
        labels = np.square(points[:, None] - centres).sum(axis=2).argmin(axis=1)
        for index in np.unique(labels):
            centres[index] = np.average(points[labels == index], axis=0, weights=weights[labels == index])
    return np.asarray(centres[labels])


@pytest.mark.parametrize("weighted", [False, True])
def test_a_palette_is_nearly_as_good_as_plain_k_means(rng: np.random.Generator, weighted: bool) -> None:
    points = (rng.normal(size=(1500, 9)) * 0.5 ** np.arange(9)).astype(np.float32)
    weights = (rng.pareto(1.5, 1500) + 0.01 if weighted else np.ones(1500)).astype(np.float32)
    palette, labels = fit_palette(points, weights, 512)
    assert 500 < len(palette) <= 512
    assert labels.shape == (1500,)
    assert 0 <= labels.min() <= labels.max() < len(palette)
    assert error(points, palette[labels], weights) < 1.25 * error(
        points, plain_k_means(points, weights, 512, rng), weights
    )


def test_points_that_weigh_more_are_nearer_to_their_entry(rng: np.random.Generator) -> None:
    points = rng.normal(size=(3000, 6)).astype(np.float32)
    weights = np.where(np.arange(3000) < 600, 100, 1).astype(np.float32)
    palette, labels = fit_palette(points, weights, 1024)
    off = np.square(points - palette[labels]).sum(axis=1)
    assert off[:600].mean() < 0.1 * off[600:].mean()


@pytest.mark.parametrize("count", [1, 40, 600])
def test_a_palette_that_holds_all_points_is_exact(rng: np.random.Generator, count: int) -> None:
    points = rng.normal(size=(count, 24)).astype(np.float32)[rng.integers(0, count, 5000)]
    palette, labels = fit_palette(points, np.ones(5000, np.float32), 1024)
    assert len(palette) == len(np.unique(points, axis=0))
    np.testing.assert_array_equal(palette[labels], points)


def test_points_most_of_which_are_alike_leave_entries_for_the_others(rng: np.random.Generator) -> None:
    points = np.zeros((20_000, 24), np.float32)
    points[:1500] = rng.normal(size=(1500, 24))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        palette, labels = fit_palette(points, np.ones(20_000, np.float32), 1024)
    assert len(palette) > 950
    assert error(points, palette[labels], np.ones(20_000)) < 0.4 * np.square(points).sum()
    np.testing.assert_allclose(palette[labels[1500:]], 0, atol=0.01)


@pytest.mark.parametrize("places", [1, 3])
@pytest.mark.parametrize("apart", [1e-30, 1e-4])
def test_points_too_near_to_tell_apart_have_a_palette(rng: np.random.Generator, places: int, apart: float) -> None:
    offset = 0.0 if apart < 1e-20 else 1000.0
    points = (offset * rng.integers(1, 1 + places, (3000, 1)) + apart * rng.normal(size=(3000, 3))).astype(
        np.float32
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        palette, labels = fit_palette(points, np.ones(3000, np.float32), 1024)
    assert len(palette) <= 1024
    np.testing.assert_allclose(palette[labels], points, atol=10 * apart, rtol=1e-6)
