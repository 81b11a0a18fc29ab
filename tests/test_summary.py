"""A scene in numbers."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.scenes import random_gaussians
from tsplat.summary import PERCENTILES, summarize

SCENE = random_gaussians(np.random.default_rng(2), 1001, 2)


def test_every_number_is_that_of_the_scene() -> None:
    summary = summarize(SCENE)
    assert (summary.count, summary.sh_degree, summary.nbytes) == (1001, 2, 1001 * 4 * (3 + 4 + 3 + 1 + 27))
    assert summary.low == tuple(SCENE.means.min(axis=0).tolist())
    assert summary.high == tuple(SCENE.means.max(axis=0).tolist())
    assert summary.opacities[50] == pytest.approx(float(np.median(SCENE.opacities)))
    assert summary.opacities[100] == pytest.approx(float(SCENE.opacities.max()))
    assert summary.scales[0] == pytest.approx(float(SCENE.scales.max(axis=1).min()))
    assert list(summary.scales) == list(PERCENTILES)
    assert 0.5 < summary.bulk_radius < 1.5


@pytest.mark.parametrize("count", [0, 1, 1001])
def test_a_summary_survives_json(count: int) -> None:
    plain = summarize(SCENE.take(range(count))).as_dict()
    assert json.loads(json.dumps(plain, allow_nan=False)) == plain
    assert plain["count"] == count
    assert (plain["low"] is None) == (count == 0)
    assert len(plain["opacities"]) == (len(PERCENTILES) if count else 0)
