"""Percentiles and histograms against NumPy's own."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tsplat.info.distribution import BINS, PERCENTILES, Axis, distribution

AXES: tuple[Axis, ...] = ("unit", "linear", "log")
VALUES = np.random.default_rng(4).lognormal(-3.0, 1.5, 1237).astype(np.float32).clip(0.0, 1.0)


def test_percentiles_are_those_of_numpy() -> None:
    found = distribution(VALUES, "log")["percentiles"]
    assert list(found) == [str(percent) for percent in PERCENTILES]
    np.testing.assert_allclose(list(found.values()), np.percentile(VALUES, PERCENTILES), rtol=1e-6)


@pytest.mark.parametrize("axis", AXES)
def test_counts_are_those_of_numpy_between_the_same_edges(axis: Axis) -> None:
    found = distribution(VALUES, axis)["histogram"]
    assert (found["axis"], len(found["counts"]), len(found["edges"])) == (axis, BINS, BINS + 1)
    expected, _ = np.histogram(VALUES.astype(np.float64), found["edges"])
    np.testing.assert_array_equal(found["counts"], expected)
    assert sum(found["counts"]) == len(VALUES)


def test_the_bins_of_a_logarithmic_axis_have_equal_ratios_between_its_ends() -> None:
    edges = np.array(distribution(VALUES, "log")["histogram"]["edges"])
    np.testing.assert_allclose(np.diff(np.log(edges[1:-1]), n=2), 0.0, atol=1e-9)
    assert (edges[0], edges[-1]) == (VALUES.min(), VALUES.max())


@pytest.mark.parametrize("axis", ["linear", "log"])
def test_one_outlier_does_not_press_the_rest_into_one_bin(axis: Axis) -> None:
    counts = distribution(np.append(VALUES, np.float32(1e30)), axis)["histogram"]["counts"]
    assert np.count_nonzero(counts) > BINS // 2
    assert counts[-1] >= 1


def test_zeros_do_not_press_the_rest_of_a_logarithmic_axis_into_one_bin() -> None:
    counts = distribution(np.append(VALUES, np.zeros(len(VALUES), np.float32)), "log")["histogram"]["counts"]
    assert counts[0] >= len(VALUES)
    assert np.count_nonzero(counts) > BINS // 4


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("value", [0.0, 1e-45, 0.25, 1.0, 3.4e38])
@pytest.mark.parametrize("count", [1, 2, 50])
def test_values_that_are_all_alike_are_in_one_bin(axis: Axis, value: float, count: int) -> None:
    found = distribution(np.full(count, value, np.float32), axis)
    assert sorted(found["histogram"]["counts"]) == [0] * (BINS - 1) + [count]
    assert np.all(np.diff(found["histogram"]["edges"]) >= 0.0)
    json.dumps(found, allow_nan=False)
    if axis == "log" and 0.1 < value < 2.0:
        assert found["histogram"]["counts"].index(count) in (BINS // 2 - 1, BINS // 2)


def test_values_from_the_smallest_to_the_largest_float_stay_finite() -> None:
    for axis in AXES:
        found = distribution(np.array([0.0, 1e-45, 1.0, 3.4e38], np.float32), axis)
        json.dumps(found, allow_nan=False)
        assert sum(found["histogram"]["counts"]) == 4
