"""The last step of every reader."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.scenes import random_gaussians
from tsplat.errors import LoadWarning
from tsplat.importance import importance
from tsplat.io.finish import finish
from tsplat.scene import Gaussians

PATH = Path("scene.x")


def parts(gaussians: Gaussians) -> list[np.ndarray]:
    arrays = gaussians.means, gaussians.quats, gaussians.scales, gaussians.opacities, gaussians.sh
    return [array.copy() for array in arrays]


def test_what_cannot_be_drawn_is_left_out_with_a_warning(rng: np.random.Generator) -> None:
    whole = random_gaussians(rng, 9, 1)
    means, quats, scales, opacities, sh = parts(whole)
    means[1, 2], quats[3], scales[4, 0], opacities[6], sh[7, 3, 1] = np.nan, 0.0, np.inf, np.nan, -np.inf
    sh[7, 2, 0] = np.inf
    with pytest.warns(LoadWarning, match=r"scene\.x: dropped 5 of 9 splats"):
        found = finish(PATH, means, quats, scales, opacities, sh, max_splats=None)
    np.testing.assert_array_equal(found.means, whole.means[[0, 2, 5, 8]])


@pytest.mark.parametrize("length", [1e-30, 1e-22, 3.0, 1e25])
def test_quats_of_any_length_become_unit_quats(rng: np.random.Generator, length: float) -> None:
    means, quats, scales, opacities, sh = parts(random_gaussians(rng, 5, 0))
    found = finish(PATH, means, np.float32(length) * quats, scales, opacities, sh, max_splats=None)
    np.testing.assert_allclose(found.quats, quats, atol=1e-6)


def test_the_weightiest_are_kept_in_the_order_of_the_file(rng: np.random.Generator) -> None:
    whole = random_gaussians(rng, 40, 0)
    found = finish(PATH, *parts(whole), max_splats=7)
    best = np.sort(np.argsort(importance(whole.scales, whole.opacities))[-7:])
    np.testing.assert_array_equal(found.means, whole.means[best])
