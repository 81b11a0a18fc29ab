"""Which splats matter most."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tsplat.importance import importance, most_important


def test_importance_grows_with_opacity_and_with_area_but_not_along_a_line() -> None:
    scales = np.array([[1, 1, 1], [1, 1, 1], [2, 2, 2], [9, 0, 0], [1e30, 1e30, 0]], np.float32)
    scores = importance(scales, np.array([1, 0.5, 1, 1, 1], np.float32))
    np.testing.assert_allclose(scores[:4], [1, 0.5, 4, 0])
    assert np.isfinite(scores).all()


@settings(deadline=None)
@given(st.lists(st.integers(-1, 5), max_size=30), st.data())
def test_the_highest_scores_are_marked_and_among_equals_the_first(scores: list[int], data: st.DataObject) -> None:
    limit = data.draw(st.integers(0, len(scores)))
    possible = [index for index, score in enumerate(scores) if score >= 0]
    best = sorted(possible, key=lambda index: (-scores[index], index))[:limit]
    marked = most_important(np.array(scores, np.float32), limit)
    assert np.flatnonzero(marked).tolist() == sorted(best)
