from __future__ import annotations

import numpy as np
import pytest

from tests.bench.conftest import Drawn
from tests.scenes import random_gaussians
from tsplat.bench import measure as module
from tsplat.bench.measure import WARM_UP, measure, measure_all
from tsplat.bench.results import FRAME
from tsplat.bench.views import VIEWS

CLOUD = random_gaussians(np.random.default_rng(1), 50, sh_degree=2)


def test_the_first_frames_do_not_count(drawn: Drawn) -> None:
    result = measure(CLOUD, "cloud", (16, 8), (1,), 3, lambda: None)
    assert len(drawn) == VIEWS * (WARM_UP + 3)
    painted = sorted(time for view in result.runs[0].views for time in view.milliseconds["paint"])
    assert painted == list(range(VIEWS * WARM_UP + 1, VIEWS * (WARM_UP + 3) + 1))


def test_thread_counts_take_turns_on_each_view(drawn: Drawn) -> None:
    measure(CLOUD, "cloud", (16, 8), (1, 2, 4), 4, lambda: None)
    groups = [drawn[start : start + 3] for start in range(0, len(drawn), 3)]
    assert all({threads for _, threads in group} == {1, 2, 4} for group in groups)
    assert all(len({id(camera) for camera, _ in group}) == 1 for group in groups)


def test_every_thread_count_is_first_equally_often(drawn: Drawn) -> None:
    measure(CLOUD, "cloud", (16, 8), (1, 2, 4), 4, lambda: None)
    first = [threads for _, threads in drawn[::3]]
    assert {first.count(threads) for threads in (1, 2, 4)} == {len(first) // 3}


def test_a_result_says_what_was_drawn(drawn: Drawn) -> None:
    result = measure(CLOUD, "cloud", (16, 8), (2,), 3, lambda: None)
    assert (result.scene, result.splats, result.sh_degree, result.frames) == ("cloud", 50, 2, 3)
    assert {(camera.width, camera.height) for camera, _ in drawn} == {(result.width, result.height)} == {(16, 8)}
    view = result.runs[0].views[0]
    assert (view.visible, view.pairs, view.blends, view.project_bytes) == (50, 7, 9, 5000)
    assert list(view.milliseconds) == ["paint", "composite", FRAME]
    assert all(len(times) == 3 for times in view.milliseconds.values())


@pytest.mark.usefixtures("ceilings")
def test_the_whole_frame_is_timed_from_outside() -> None:
    for view in measure(CLOUD, "cloud", (64, 48), (1, 2), 2, lambda: None).runs[1].views:
        stages = [times for stage, times in view.milliseconds.items() if stage != FRAME]
        assert np.all(np.sum(stages, axis=0) <= view.milliseconds[FRAME])


def test_progress_grows_to_the_end_and_names_what_is_timed(drawn: Drawn) -> None:
    shown: list[tuple[str, float]] = []
    scenes = [("one", CLOUD), ("two", CLOUD)]
    results, _ = measure_all(scenes, [(8, 8), (9, 8)], (1, 2), 2, lambda *args: shown.append(args))
    fractions = [fraction for _, fraction in shown]
    assert fractions == sorted(fractions)
    assert fractions[0] == 0.0
    assert fractions[-1] == 1.0
    assert [(result.scene, result.width) for result in results] == [("one", 8), ("one", 9), ("two", 8), ("two", 9)]
    assert {text for text, _ in shown[1:]} == {"one 8 x 8", "one 9 x 8", "two 8 x 8", "two 9 x 8"}
    assert len(drawn) == len(results) * VIEWS * 2 * (WARM_UP + 2)


def test_a_disturbed_ceiling_does_not_lower_it(drawn: Drawn, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: ARG001
    blends, copies = iter([3.0, 1.0]), iter([4.0, 5.0])
    monkeypatch.setattr(module, "blends_per_second", lambda: next(blends))
    monkeypatch.setattr(module, "copy_bytes_per_second", lambda: next(copies))
    _, ceilings = measure_all([("one", CLOUD)], [(8, 8)], (1,), 1, lambda *_: None)
    assert (ceilings.blends_per_second, ceilings.copy_bytes_per_second) == (3.0, 5.0)
