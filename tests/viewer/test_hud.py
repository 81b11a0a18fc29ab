"""The text over the picture, read back from a terminal emulator."""

from __future__ import annotations

import pyte
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.viewer.states import a_state
from tsplat.terminal.keys import TerminalSize
from tsplat.viewer import help
from tsplat.viewer.hud import WIDTH, Measured, layout
from tsplat.viewer.settings import SETTINGS
from tsplat.viewer.spans import STYLES, Span, clipped, erased, fitted, painted
from tsplat.viewer.state import ViewerState

MEASURED = Measured(
    fps=59.6,
    visible=123456,
    width=800,
    height=480,
    stage_ms={"project": 17.25, "sh": 1.5, "bin": 5.25, "composite": 120.5, "encode": 3.5, "write": 2.0},
    terminal="kitty 0.26.5",
    protocol="kitty, sixel, 24-bit, sync, keys",
)
SIZES = [(80, 24), (40, 12), (200, 60), (20, 5), (1, 1)]


def shown(state: ViewerState) -> pyte.Screen:
    """Return the screen of a terminal, filled with dots, after the overlay was drawn."""
    screen = pyte.Screen(state.size.columns, state.size.rows)
    stream = pyte.ByteStream(screen)
    stream.feed(b"\x1b[?7l\x1b[H" + b"\r\n".join([b"." * state.size.columns] * state.size.rows))
    stream.feed(painted(layout(state, MEASURED)))
    return screen


def at(columns: int, rows: int, **changes: object) -> ViewerState:
    return a_state(size=TerminalSize(columns, rows, 10, 20), **changes)


def test_the_badge_stands_at_the_top_right() -> None:
    assert shown(at(80, 24)).display[0].endswith(". 60 fps | 123,456 splats ")


def test_the_message_stands_at_the_bottom_left() -> None:
    display = shown(at(80, 24, message="saved view-001.png")).display
    assert display[23].startswith(" saved view-001.png ...")


def test_the_badge_says_that_splats_are_merged() -> None:
    (badge,) = layout(a_state(message=""), Measured(fps=40.0, visible=24_000, detail="merged"))
    assert badge.text == " 40 fps | 24,000 splats, merged "


def test_without_a_panel_or_message_only_the_badge_is_drawn() -> None:
    display = shown(at(80, 24)).display
    assert display[1:] == ["." * 80] * 23


@pytest.mark.parametrize(("columns", "rows"), SIZES)
@pytest.mark.parametrize("panel", ["", "hud", "help"])
@pytest.mark.parametrize("row", [0, 7, len(SETTINGS) - 1])
def test_nothing_leaves_the_screen(columns: int, rows: int, panel: str, row: int) -> None:
    state = at(columns, rows, panel=panel, row=row, message="x" * 300)
    for span in layout(state, MEASURED):
        assert 0 <= span.row < rows
        assert span.column >= 0
        assert span.column + len(span.text) <= columns


def test_the_hud_shows_every_setting_and_every_fact_at_80_by_24() -> None:
    text = "\n".join(shown(at(80, 24, panel="hud")).display)
    for setting in SETTINGS:
        assert setting.label in text
        assert setting.show(a_state()) in text
    for fact in ("800 x 480 px", "cell 10 x 20 px", "kitty 0.26.5", "composite 120.5", "all 150.0", "yaw", "eye"):
        assert fact in text
    assert ". 60 fps | 123,456 splats " in text


@pytest.mark.parametrize("row", range(len(SETTINGS)))
def test_the_selected_row_is_in_view_marked_and_highlighted_on_a_small_screen(row: int) -> None:
    screen = shown(at(40, 12, panel="hud", row=row))
    (line,) = [place for place, text in enumerate(screen.display) if "◂" in text]
    assert SETTINGS[row].label in screen.display[line]
    assert f"◂ {SETTINGS[row].show(a_state())} ▸" in screen.display[line]
    other = next(place for place in range(4) if place != line)
    assert screen.buffer[line][1].bg != screen.buffer[other][1].bg


def test_the_panel_is_a_rectangle_with_a_background_of_its_own() -> None:
    screen = shown(at(80, 24, panel="hud"))
    for row in range(23):
        cells = [screen.buffer[row][column] for column in range(WIDTH)]
        assert all(cell.bg != "default" for cell in cells)
        assert screen.buffer[row][WIDTH].bg == "default"
    assert all(cell.data == "." for cell in screen.buffer[23].values())


def test_values_stand_in_one_column() -> None:
    state = at(80, 24, panel="hud", row=3)
    display = shown(state).display
    starts = {display[row].index(setting.show(state), 16) for row, setting in enumerate(SETTINGS)}
    assert len(starts) == 1


def test_the_help_differs_by_mode_and_names_every_key() -> None:
    orbit = "\n".join(shown(at(80, 24, panel="help")).display)
    fly = "\n".join(shown(at(80, 24, panel="help", mode="fly")).display)
    assert "Orbiting" in orbit
    assert "fly instead" in orbit
    assert "Flying" in fly
    assert "look around" in fly
    for text in (orbit, fly):
        for key in ("drag", "wheel", "W S", "A D", "R F", "J K", "H L", "Space", "Home", "Tab", "Ctrl-Z", "Esc"):
            assert key in text


def test_help_that_does_not_fit_scrolls_to_its_end() -> None:
    top = "\n".join(shown(at(40, 12, panel="help")).display)
    end = "\n".join(shown(at(40, 12, panel="help", scroll=help.HEIGHT)).display)
    assert "drag" in top
    assert "Ctrl-C" not in top
    assert "Ctrl-C" in end


def test_every_style_keeps_to_the_256_colours_and_names_its_background() -> None:
    for letters, background, color in STYLES.values():
        assert "38;5;" in letters
        assert 16 <= background <= 255
        level = 8 + 10 * (background - 232)
        assert color == ((level,) * 3 if background >= 232 else (0, 95, 175))


def test_control_characters_never_reach_the_terminal() -> None:
    state = at(80, 24, message="saved \x1b[2J\n.png")
    measured = Measured(terminal="evil\x1b]0;title\x07")
    for span in layout(state, measured) + layout(at(80, 24, panel="hud"), measured):
        assert span.text.isprintable()


def test_wide_characters_count_as_two_cells() -> None:
    assert fitted("日本", 5) == "日本 "
    assert fitted("日本語", 5) == "日本…"
    (span,) = layout(at(20, 4, message="日本語" * 10), MEASURED)
    assert span.text == " 日本語日本語日本語…"


spans = st.lists(
    st.builds(Span, st.integers(0, 7), st.integers(0, 30), st.text("ab", max_size=12), st.just("fact"))
)


@given(spans, spans)
def test_erasing_blanks_what_the_new_text_leaves_and_nothing_else(old: list[Span], new: list[Span]) -> None:
    old, new = clipped(old, 32, 8), clipped(new, 32, 8)
    screen = pyte.Screen(32, 8)
    stream = pyte.ByteStream(screen)
    stream.feed(b"\x1b[?7l" + painted(old) + erased(old, new) + painted(new))
    expected = pyte.Screen(32, 8)
    pyte.ByteStream(expected).feed(b"\x1b[?7l" + painted(new))
    assert screen.display == expected.display


@given(st.integers(-3, 90), st.integers(-3, 30), st.text(max_size=100))
def test_clipping_keeps_spans_inside(column: int, row: int, text: str) -> None:
    for span in clipped([Span(row, column, text, "fact")], 80, 24):
        assert 0 <= span.row < 24
        assert span.column >= 0
