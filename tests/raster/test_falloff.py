"""The falloff of a splat against the exponential that it stands for."""

from __future__ import annotations

import numpy as np

from tsplat._jit import kernel
from tsplat._lanes import load, store
from tsplat.raster.falloff import OFFSET, SCALE, alpha_of


@kernel
def _alphas(levels, alphas):  # type: ignore[no-untyped-def]
    for at in range(0, len(levels), 8):
        store(alphas, at, alpha_of(load(levels, at)))


def alphas(exponents: np.ndarray) -> np.ndarray:
    found = np.zeros(len(exponents), np.float32)
    _alphas((SCALE * exponents + OFFSET).astype(np.float32), found)
    return found


def test_the_falloff_is_within_its_error_of_a_power_of_two() -> None:
    exponents = np.linspace(-8, 0, 8000)
    np.testing.assert_allclose(alphas(exponents), 2.0**exponents, rtol=6.1e-4)


def test_fainter_than_the_faintest_that_is_usual_the_falloff_is_nearly_nothing() -> None:
    exponents = np.linspace(-13.3, -8, 8000)
    np.testing.assert_allclose(alphas(exponents), 2.0**exponents, atol=3e-5)
