from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsplat.bench.results import FRAME, Ceilings, SceneResult, Spread, ThreadRun, ViewTimes

CEILINGS = Ceilings(blends_per_second=2e9, copy_bytes_per_second=1e10)


def times(name: str, composite: list[float], *, project: float = 1.0, blends: int = 1_000_000) -> ViewTimes:
    milliseconds = {
        "project": [project] * len(composite),
        "composite": composite,
        FRAME: [project + each for each in composite],
    }
    return ViewTimes(name, milliseconds, visible=10, pairs=20, blends=blends, project_bytes=3_000_000)


def test_a_spread_is_that_of_its_times() -> None:
    spread = Spread.of(list(range(101)))
    assert spread == Spread(mean=50.0, min=0.0, p50=50.0, p95=95.0, p99=99.0)
    assert Spread.of([3.0]) == Spread(3.0, 3.0, 3.0, 3.0, 3.0)


@given(st.lists(st.floats(0.0, 1e6), min_size=1))
def test_a_spread_is_in_order_and_within_its_times(milliseconds: list[float]) -> None:
    spread = Spread.of(milliseconds)
    assert min(milliseconds) == spread.min <= spread.p50 <= spread.p95 <= spread.p99 <= max(milliseconds)
    assert spread.min <= spread.mean * (1 + 1e-12)
    assert spread.mean <= max(milliseconds) * (1 + 1e-12)


def test_rates_are_of_the_shortest_frames_of_each_view() -> None:
    quiet = ThreadRun(1, (times("a", [2.0, 2.0]), times("b", [4.0, 4.0])))
    disturbed = ThreadRun(1, (times("a", [2.0, 90.0]), times("b", [70.0, 4.0])))
    for run in (quiet, disturbed):
        assert run.blends_per_second == pytest.approx(2_000_000 / 6e-3)
        assert run.frame_ms == pytest.approx((3.0 + 5.0) / 2)
        assert run.micro_kernel_share(CEILINGS) == pytest.approx(1 / 6)
        assert run.copy_share(CEILINGS) == pytest.approx(6e6 / 2e-3 / 1e10)


def test_a_stage_that_is_short_in_a_long_frame_makes_no_rate() -> None:
    honest = times("a", [2.0, 4.0])
    honest.milliseconds["composite"][1] = 0.001
    run = ThreadRun(2, (honest,))
    assert run.blends_per_second == pytest.approx(1e6 / 2e-3)
    assert run.spreads["composite"].min == 0.001


def test_the_share_of_the_micro_kernel_is_each_threads() -> None:
    one, two = (ThreadRun(threads, (times("a", [1.0]),)) for threads in (1, 2))
    assert one.blends_per_second == two.blends_per_second == pytest.approx(1e9)
    assert one.micro_kernel_share(CEILINGS) == pytest.approx(0.5)
    assert two.micro_kernel_share(CEILINGS) == pytest.approx(0.25)


def test_what_was_not_measured_is_unknown_and_not_zero() -> None:
    nothing = ThreadRun(2, (times("a", [1.0], blends=0),))
    assert nothing.blends_per_second is nothing.micro_kernel_share(CEILINGS) is None
    assert nothing.copy_share(CEILINGS) is None  # the copy has one thread
    assert nothing.speedup(None) is None
    assert SceneResult("a", 1, 0, 8, 8, 1, (nothing,)).one_thread is None
    other = ThreadRun(1, (ViewTimes("a", {"paint": [1.0], FRAME: [2.0]}, blends=5, project_bytes=5),))
    assert other.blends_per_second is other.copy_share(CEILINGS) is None


def test_stages_keep_their_order_and_the_frame_is_last() -> None:
    run = ThreadRun(1, (ViewTimes("a", {FRAME: [3.0], "b": [1.0], "a": [2.0]}), ViewTimes("b", {"c": [1.0]})))
    assert list(run.spreads) == ["b", "a", "c", FRAME]


def test_speed_up_compares_the_shortest_frames() -> None:
    one = ThreadRun(1, (times("a", [5.0, 9.0]),))
    two = ThreadRun(2, (times("a", [9.0, 2.0]),))
    assert two.speedup(one) == pytest.approx(6.0 / 3.0)
    assert one.speedup(one) == 1.0
    assert np.isclose(one.speedup(two), 0.5)
