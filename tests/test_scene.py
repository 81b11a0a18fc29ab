"""`Gaussians` are checked once, own their arrays, and stay the same through a worker process."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

from tests.scenes import random_gaussians
from tsplat.errors import SceneError, TsplatError
from tsplat.scene import Gaussians

FIELDS = ("means", "quats", "scales", "opacities", "sh")


def arrays(n: int = 4, k: int = 9) -> dict[str, Any]:
    return {
        "means": np.zeros((n, 3), np.float32),
        "quats": np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)),
        "scales": np.ones((n, 3), np.float32),
        "opacities": np.full(n, 0.5, np.float32),
        "sh": np.zeros((n, k, 3), np.float32),
    }


@pytest.mark.parametrize("degree", range(4))
@pytest.mark.parametrize("n", [0, 1, 50])
def test_a_scene_knows_its_size(n: int, degree: int) -> None:
    k = (degree + 1) ** 2
    gaussians = Gaussians(**arrays(n, k))
    assert (len(gaussians), gaussians.sh_degree, gaussians.nbytes) == (n, degree, 4 * n * (11 + 3 * k))


def test_arrays_are_taken_without_a_copy_and_cannot_be_written() -> None:
    given = arrays()
    gaussians = Gaussians(**given)
    for name in FIELDS:
        kept = getattr(gaussians, name)
        assert np.shares_memory(kept, given[name])
        assert given[name].flags.writeable, "the caller's own array stays as it was"
        with pytest.raises(ValueError, match="read-only"):
            kept[...] = 0


@pytest.mark.parametrize("change", ["float64", "big-endian", "Fortran order", "every other row", "lists"])
def test_any_layout_becomes_the_one_layout(change: str) -> None:
    given = arrays()
    given["means"] = means = np.arange(12, dtype=np.float32).reshape(4, 3)
    given["means"] = {
        "float64": means.astype(np.float64),
        "big-endian": means.astype(">f4"),
        "Fortran order": np.asfortranarray(means),
        "every other row": np.repeat(means, 2, axis=0)[::2],
        "lists": means.tolist(),
    }[change]
    kept = Gaussians(**given).means
    assert kept.dtype == np.float32
    assert kept.dtype.isnative
    assert kept.flags.c_contiguous
    np.testing.assert_array_equal(kept, means)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("means", np.zeros((4, 2)), r"means must have shape \[4, 3\], got \[4, 2\]"),
        ("means", 1.0, "means must have shape"),
        ("quats", np.zeros((4, 3)), r"quats must have shape \[4, 4\]"),
        ("scales", np.zeros((3, 3)), r"scales must have shape \[4, 3\]"),
        ("opacities", np.zeros((4, 1)), r"opacities must have shape \[4\]"),
        ("sh", np.zeros((4, 3)), r"sh must have shape \[4, K, 3\]"),
        ("sh", np.zeros((4, 5, 3)), "K in"),
        ("sh", np.zeros((3, 4, 3)), r"sh must have shape \[4, 4, 3\]"),
        ("scales", np.full((4, 3), -1e-3), r"scales must lie in \[0.0, inf\]"),
        ("opacities", np.full(4, 1.01), r"opacities must lie in \[0.0, 1.0\]"),
        ("opacities", np.full(4, -0.01), "opacities must lie in"),
    ],
)
def test_arrays_that_do_not_fit_are_refused_by_name(name: str, value: Any, message: str) -> None:
    with pytest.raises(SceneError, match=message) as caught:
        Gaussians(**{**arrays(), name: value})
    assert isinstance(caught.value, TsplatError)


@pytest.mark.parametrize("name", FIELDS)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_nan_and_inf_are_refused_wherever_they_are(name: str, value: float) -> None:
    given = arrays()
    given[name].ravel()[-1] = value
    with pytest.raises(SceneError, match=f"{name} must be finite"):
        Gaussians(**given)


def test_what_is_known_to_be_finite_is_checked_for_all_else() -> None:
    given = arrays()
    scene = Gaussians.of_finite(**given, antialiased=True)
    for name, array in given.items():
        assert np.shares_memory(getattr(scene, name), array)
        assert not getattr(scene, name).flags.writeable
    assert scene.antialiased
    for name, value in {
        "scales": -np.ones((4, 3)),
        "opacities": np.full(4, 2.0),
        "quats": np.ones((4, 3)),
    }.items():
        with pytest.raises(SceneError, match=f"{name} must"):
            Gaussians.of_finite(**{**given, name: value}, antialiased=False)


def test_the_largest_finite_numbers_are_finite() -> None:
    given = arrays()
    given["means"][...] = np.finfo(np.float32).max
    assert len(Gaussians(**given)) == 4


def test_a_pickled_scene_is_the_same_and_still_read_only() -> None:
    before = random_gaussians(np.random.default_rng(0), 20, 2)
    after = pickle.loads(pickle.dumps(before))
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))
        assert not getattr(after, name).flags.writeable


def test_taking_keeps_the_order_of_the_indices() -> None:
    scene = random_gaussians(np.random.default_rng(0), 20, 1)
    chosen = scene.take([7, 3, 3])
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(chosen, name), getattr(scene, name)[[7, 3, 3]])
    assert len(scene.take([])) == 0
