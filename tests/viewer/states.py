"""States to begin a viewer's tests from."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from tsplat.camera import Pose
from tsplat.terminal.keys import TerminalSize
from tsplat.viewer.state import ViewerState

START = Pose.look_at((0.5, -1.0, -4.0), (0.0, 0.0, 0.0), (0.0, -1.0, 0.0))


def a_state(**changes: Any) -> ViewerState:
    """Return a state that looks at the origin from outside, with ``changes``."""
    state = ViewerState(
        pose=START,
        start=START,
        radius=2.0,
        size=TerminalSize(80, 24, 10, 20),
        outputs=("kitty", "sixel", "half", "half256"),
        output="kitty",
        total=1000,
        kept=1000,
        threads=4,
    )
    return replace(state, **changes)
