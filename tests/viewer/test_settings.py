"""Every row of the HUD steps, stays in range and shows its value."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.viewer.states import a_state
from tsplat.viewer.settings import SETTINGS, step_row, stepped
from tsplat.viewer.state import ViewerState, picture

ROWS = [setting.label for setting in SETTINGS]


def walk(state: ViewerState, by: int) -> list[str]:
    """Return what the selected row shows at each step until it comes round or stays."""
    shown = [SETTINGS[state.row].show(state)]
    while True:
        state = step_row(state, by)
        text = SETTINGS[state.row].show(state)
        if text in shown:
            return shown
        shown.append(text)


@pytest.mark.parametrize("row", range(len(ROWS)), ids=ROWS)
def test_every_row_has_several_values_each_shown_differently(row: int) -> None:
    up, down = walk(a_state(row=row), 1), walk(a_state(row=row), -1)
    assert len({*up, *down}) >= 2
    assert all(len(text) <= 22 for text in (*up, *down))


@pytest.mark.parametrize("row", range(len(ROWS)), ids=ROWS)
def test_a_step_there_and_back_shows_the_same_value(row: int) -> None:
    for first, second in ((1, -1), (-1, 1)):
        start = a_state(row=row)
        away = step_row(start, first)
        if SETTINGS[row].show(away) != SETTINGS[row].show(start):
            back = step_row(away, second)
            assert SETTINGS[row].show(back) == SETTINGS[row].show(start)


@pytest.mark.parametrize("row", range(len(ROWS)), ids=ROWS)
def test_a_row_changes_the_picture_unless_it_is_a_speed(row: int) -> None:
    start = a_state(row=row)
    changed = {picture(step_row(start, by)) for by in (1, -1)} != {picture(start)}
    assert changed == ("speed" not in ROWS[row])


@given(st.integers(0, len(ROWS) - 1), st.lists(st.sampled_from([-1, 1]), max_size=60), st.integers(1, 5))
def test_no_row_can_leave_the_range_its_option_allows(row: int, steps: list[int], total: int) -> None:
    state = a_state(row=row, total=total, kept=total, scene_degree=1)
    for by in steps:
        state = step_row(state, by)  # RenderOptions refuses what it cannot take
    assert 1 <= state.kept <= total
    assert 0.0 < state.fov_y < 180.0
    assert state.speeds.zoom > 1.0


@given(st.floats(-10, 10), st.sampled_from([-1, 1]))
def test_a_step_never_goes_the_wrong_way(value: float, by: int) -> None:
    assert by * (stepped((0.0, 1.0, 2.5), value, by) - value) >= 0.0


def test_a_scene_without_higher_bands_says_so() -> None:
    state = a_state(scene_degree=1, row=ROWS.index("SH degree"))
    assert SETTINGS[state.row].show(state) == "1"
    assert SETTINGS[state.row].show(step_row(state, -1)) == "0"


@pytest.mark.parametrize("by", [-1, 1])
@pytest.mark.parametrize(("label", "shown"), [("splats kept", "1,000 (as stored)"), ("opacity", "as stored")])
def test_what_a_scene_on_disk_has_no_variants_of_does_not_step(label: str, shown: str, by: int) -> None:
    state = a_state(on_disk=True, row=ROWS.index(label))
    assert SETTINGS[state.row].show(state) == shown
    assert step_row(state, by) == state
