"""The screen of a real kitty while the view turns: a picture at every moment."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest

from tests.e2e.terminals import Window
from tests.e2e.test_terminals import KITTY
from tests.e2e.visit import BACKGROUND, PATIENCE, Case, Visit

pytestmark = pytest.mark.e2e

SAMPLES = 4000
PICTURES = 40
"""Different pictures that the samples must hold, so that there was motion to look at."""

PATCH = np.s_[220:260, 340:460]
"""Where the demo's robot is seen from all sides, far from any text."""


def test_kitty_never_shows_a_blank_screen_while_the_view_turns(visit: Callable[[Case], Visit]) -> None:
    viewer = visit(KITTY)
    viewer.begin()
    viewer.until_alike()
    assert isinstance(viewer.terminal, Window)
    patch = viewer.terminal.pixels[PATCH]
    empty = {(0, 0, 0), tuple(bytes.fromhex(BACKGROUND[1:]))}

    viewer.terminal.press("Left")
    seen: set[int] = set()
    samples = blank = 0
    end = time.monotonic() + PATIENCE
    while (samples < SAMPLES or len(seen) < PICTURES) and time.monotonic() < end:
        sample = patch.copy()
        samples += 1
        first = sample[0, 0]
        blank += bool((sample == first).all()) and tuple(first.tolist()) in empty
        seen.add(hash(sample.tobytes()))
        time.sleep(5e-4)  # leaves the processor to those who draw
    viewer.terminal.let_go("Left")

    assert blank == 0, f"{blank} of {samples} samples without a picture"
    assert samples >= SAMPLES
    assert len(seen) >= PICTURES
