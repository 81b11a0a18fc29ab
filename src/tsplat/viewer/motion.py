"""From held keys and the mouse to the next pose.

In orbit the eye goes around the target, and a drag takes the scene along; in flight the view turns
about the eye, and a drag takes the picture along.
"""

from __future__ import annotations

import math
from dataclasses import replace

from tsplat.encode import FALLBACK_CELL
from tsplat.viewer.state import AUTO_ORBIT, Held, Tick, ViewerState

MOTIONS: dict[str, tuple[int, int, int, int, int, int]] = {
    "right": (1, 0, 0, 0, 0, 0),
    "left": (-1, 0, 0, 0, 0, 0),
    "up": (0, 1, 0, 0, 0, 0),
    "down": (0, -1, 0, 0, 0, 0),
    "forward": (0, 0, 1, 0, 0, 0),
    "back": (0, 0, -1, 0, 0, 0),
    "yaw right": (0, 0, 0, 1, 0, 0),
    "yaw left": (0, 0, 0, -1, 0, 0),
    "pitch up": (0, 0, 0, 0, 1, 0),
    "pitch down": (0, 0, 0, 0, -1, 0),
    "zoom in": (0, 0, 0, 0, 0, 1),
    "zoom out": (0, 0, 0, 0, 0, -1),
}
"""What each motion does: right, up, forward, yaw right, pitch up, zoom in."""

NEAREST, FARTHEST = 1e-4, 1e4
"""Limits of the target's distance, in scene radii: beyond them float32 has nothing left to show."""

WHEEL_SECONDS = 0.2
"""One notch of the wheel zooms as far as the key does in this time."""

DRAG_TURN = math.pi
"""Radians that a drag over the whole height of the screen orbits."""


def tick(state: ViewerState, event: Tick) -> ViewerState:
    """Return the state after the time passed: held keys act, the automatic orbit goes on."""
    seconds = max(0.0, event.seconds)
    for held in state.held:
        lasting = seconds if held.down else min(seconds, held.owed)
        state = act(state, held.motion, lasting)
    if state.auto_orbit:
        state = replace(state, pose=state.pose.orbit(-math.radians(AUTO_ORBIT) * seconds, 0.0))
    left = (replace(held, owed=max(0.0, held.owed - seconds)) for held in state.held)
    return replace(state, held=tuple(held for held in left if held.down or held.owed > 0.0))


def act(state: ViewerState, motion: str, seconds: float) -> ViewerState:
    """Return the state after one motion lasted for this many seconds."""
    right, up, forward, yaw, pitch, zoom = MOTIONS[motion]
    if zoom:
        return zoomed(state, zoom * seconds)
    if yaw or pitch:
        angle = math.radians(state.speeds.turn) * seconds
        return turned(state, yaw * angle, pitch * angle)
    length = state.speeds.move * seconds * (state.pose.distance if state.mode == "orbit" else state.radius)
    return replace(state, pose=state.pose.move(right * length, up * length, forward * length))


def turned(state: ViewerState, yaw: float, pitch: float) -> ViewerState:
    """Return the state with the eye gone right and up around the target, or the view turned so, in radians."""
    if state.mode == "orbit":
        # The eye that goes right and up must look left and down to keep its target.
        return replace(state, pose=state.pose.orbit(-yaw, -pitch))
    return replace(state, pose=state.pose.turn(yaw, pitch))


def zoomed(state: ViewerState, seconds: float) -> ViewerState:
    """Return the state after zooming in for this many seconds; out where negative."""
    wanted = state.pose.distance * state.speeds.zoom**-seconds
    distance = min(max(wanted, NEAREST * state.radius), FARTHEST * state.radius)
    return replace(state, pose=state.pose.zoom(distance / state.pose.distance))


def dragged(state: ViewerState, columns: float, rows: float, *, pan: bool) -> ViewerState:
    """Return the state after the pointer went right and down by this many cells with a button down."""
    cell_width, cell_height = state.size.cell_size if all(state.size.cell_size) else FALLBACK_CELL
    # Of the screen's height, as a cell is about twice as high as wide.
    across = columns * cell_width / (state.size.rows * cell_height)
    down = rows / state.size.rows
    if pan:
        span = 2.0 * state.pose.distance * math.tan(0.5 * math.radians(state.fov_y))
        return replace(state, pose=state.pose.move(-across * span, down * span, 0.0))
    angle = DRAG_TURN if state.mode == "orbit" else math.radians(state.fov_y)
    return turned(state, -across * angle, down * angle)


def pressed(state: ViewerState, motion: str) -> ViewerState:
    """Return the state with a motion's key down."""
    others = tuple(held for held in state.held if held.motion != motion)
    return replace(state, held=(*others, Held(motion, down=state.releases)))


def released(state: ViewerState, motion: str) -> ViewerState:
    """Return the state with a motion's key up; a tap still gets the time it is owed."""
    held = (replace(held, down=False) if held.motion == motion else held for held in state.held)
    return replace(state, held=tuple(held for held in held if held.down or held.owed > 0.0))
