"""The viewer in real terminals, compared with what the renderer made."""

from __future__ import annotations

import math
import signal
from collections.abc import Callable

import numpy as np
import pytest

from tests.e2e.visit import Case, Visit

pytestmark = pytest.mark.e2e

KITTY = Case("kitty", "kitty", math.inf)
CASES = [
    KITTY,
    Case("xterm", "sixel", 33.0),
    Case("mlterm", "sixel", 33.0),
    Case("mlterm", "iterm2", 38.0),
    Case("foot", "sixel", 33.0),
    Case("foot", "half", math.inf),
    Case("foot", "sextant", 33.0),
    Case("alacritty", "half", math.inf),
    Case("tmux", "half", math.inf),
    Case("tmux", "quadrant", 33.0),
    Case("xterm.js", "kitty", math.inf),
    Case("xterm.js", "sixel", 33.0),
]
ONCE_EACH = list({case.terminal: case for case in reversed(CASES)}.values())

Open = Callable[[Case], Visit]


@pytest.mark.parametrize("case", CASES, ids=str)
def test_the_screen_is_the_frame_that_was_rendered_and_turns_with_a_key(visit: Open, case: Case) -> None:
    viewer = visit(case)
    viewer.begin()
    viewer.until_alike()
    start = viewer.terminal.screen()

    viewer.turned()
    assert viewer.likeness(start) < 25.0, "a turned view could not be told from the first"

    viewer.home()
    viewer.until_alike()


@pytest.mark.parametrize("case", ONCE_EACH, ids=str)
def test_the_picture_turns_while_a_key_is_down_and_no_longer(visit: Open, case: Case) -> None:
    viewer = visit(case)
    viewer.begin()
    viewer.until_alike()

    viewer.terminal.press("Left")
    seen = [viewer.terminal.screen()]

    def another() -> bool:
        screen = viewer.terminal.screen()
        if all(not np.array_equal(screen, before) for before in seen):
            seen.append(screen)
        return len(seen) > 5

    viewer.until(another, "fifth picture")
    viewer.terminal.let_go("Left")
    assert viewer.likeness(viewer.at_rest()) < 25.0, "at rest, but where it began"

    viewer.home()
    viewer.until_alike()


@pytest.mark.parametrize("case", ONCE_EACH, ids=str)
def test_a_terminal_of_another_size_is_filled_again(visit: Open, case: Case) -> None:
    viewer = visit(case)
    viewer.begin()
    viewer.until_alike()
    viewer.resized()
    viewer.until_alike()


LEFT_BY = [(case, number) for case in ONCE_EACH for number in (None, signal.SIGTERM)] + [(KITTY, signal.SIGSEGV)]


@pytest.mark.parametrize(("case", "number"), LEFT_BY, ids=str)
def test_the_shell_finds_its_screen_and_its_tty_as_they_were(
    visit: Open, case: Case, number: signal.Signals | None
) -> None:
    viewer = visit(case)
    viewer.begin()
    viewer.until_alike()
    assert not np.array_equal(viewer.terminal.screen(), viewer.before)
    if number:
        viewer.signal(number)
    else:
        viewer.terminal.tap("q")

    status, modes = viewer.file("after").split("\n", 1)
    assert status == {None: "0", signal.SIGTERM: "143", signal.SIGSEGV: "-11"}[number]
    assert modes == viewer.file("before")
    assert {"echo", "icanon", "isig"} <= set(modes.replace(";", " ").split())
    viewer.until(lambda: np.array_equal(viewer.terminal.screen(), viewer.before), "screen as before")
