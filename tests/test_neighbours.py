"""The nearest neighbours, against looking at all pairs."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tsplat.kd_tree import LEAF, kd_tree
from tsplat.neighbours import mean_gaps

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]


def by_all_pairs(means: F32, sizes: F32, count: int) -> F64:
    points = means.astype(np.float64)
    distances = np.linalg.norm(points[:, None] - points[None], axis=2)
    np.fill_diagonal(distances, np.inf)
    nearest = np.argsort(distances, axis=1)[:, : min(count, len(points) - 1)]
    if not nearest.size:
        return np.zeros(len(points))
    both = sizes[:, None].astype(np.float64) + sizes[nearest]
    return np.asarray((np.take_along_axis(distances, nearest, axis=1) / both).mean(axis=1))


def clouds(rng: np.random.Generator, n: int) -> dict[str, F32]:
    alike = rng.normal(size=(n, 3))
    return {
        "a cloud": alike,
        "two clouds far apart": alike + np.where(np.arange(n) % 3, 0.0, 1e6)[:, None],
        "with points beyond all measure": np.where(np.arange(n)[:, None] % 50, alike, 3e38),
        "a grid": rng.integers(0, 4, (n, 3)),
        "one place": np.full((n, 3), 7.0),
        "a line": np.arange(n)[:, None] * [1.0, 0.0, 0.0],
        "heavy tails": rng.standard_cauchy((n, 3)),
    }


@pytest.mark.parametrize("kind", clouds(np.random.default_rng(0), 1))
@pytest.mark.parametrize("n", [0, 1, 2, 5, LEAF, LEAF + 1, 4 * LEAF, 700])
def test_the_nearest_are_those_that_all_pairs_know(kind: str, n: int) -> None:
    rng = np.random.default_rng(n)
    means = clouds(rng, n)[kind].astype(np.float32)
    # Where several are equally far, any of them may be the nearest, so that sizes must be alike.
    sizes = rng.uniform(0.1, 2.0, n) if kind in ("a cloud", "heavy tails") else np.ones(n)
    np.testing.assert_allclose(mean_gaps(means, sizes, 16), by_all_pairs(means, sizes, 16), rtol=1e-12)


@settings(max_examples=50)
@given(st.lists(st.tuples(*[st.floats(-(2.0**100), 2.0**100, width=32)] * 3), max_size=60), st.integers(1, 20))
def test_no_places_are_too_odd(points: list[tuple[float, float, float]], count: int) -> None:
    means, sizes = np.array(points, np.float32).reshape(-1, 3), np.ones(len(points), np.float32)
    np.testing.assert_allclose(mean_gaps(means, sizes, count), by_all_pairs(means, sizes, count), rtol=1e-12)


def test_splats_of_no_size_are_finitely_far_from_each_other() -> None:
    means = np.array([[0, 0, 0], [0, 0, 0], [3e38, 0, 0]], np.float32)
    gaps = mean_gaps(means, np.zeros(3, np.float32), 2)
    assert np.isfinite(gaps).all()
    assert gaps.argmax() == 2


def test_the_order_of_the_points_is_the_order_of_the_gaps() -> None:
    rng = np.random.default_rng(2)
    means, sizes = rng.normal(size=(300, 3)).astype(np.float32), rng.uniform(1, 2, 300).astype(np.float32)
    order = rng.permutation(300)
    np.testing.assert_allclose(mean_gaps(means[order], sizes[order], 5), mean_gaps(means, sizes, 5)[order])


def test_progress_grows_to_one() -> None:
    heard: list[float] = []
    means = np.random.default_rng(0).normal(size=(40_000, 3)).astype(np.float32)
    mean_gaps(means, np.ones(40_000, np.float32), 4, heard.append)
    assert len(heard) > 1
    assert heard == sorted(heard)
    assert heard[-1] == 1.0


@pytest.mark.parametrize("n", [1, LEAF, LEAF + 1, 1000, 1024, 1025])
def test_every_box_is_around_its_points_and_every_point_is_in_one_leaf(n: int) -> None:
    means = np.random.default_rng(n).normal(size=(n, 3)).astype(np.float32)
    tree = kd_tree(means)
    assert np.array_equal(tree.points, means[tree.source_from_sorted])
    assert sorted(tree.source_from_sorted) == list(range(n))
    leaves = len(tree.starts) - 1
    assert (tree.starts[0], tree.starts[-1]) == (0, n)
    assert 1 <= np.diff(tree.starts).min() <= np.diff(tree.starts).max() <= LEAF
    for box in range(1, 2 * leaves):
        level = box.bit_length() - 1
        width = leaves >> level
        first = (box - (1 << level)) * width
        inside = tree.points[tree.starts[first] : tree.starts[first + width]]
        assert np.array_equal(tree.boxes[box], np.concatenate([inside.min(axis=0), inside.max(axis=0)]))
