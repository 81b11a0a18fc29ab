"""The pure core: a state and an event in, the next state out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from tsplat.terminal.keys import Focus, Key, Mouse, Resize
from tsplat.viewer import help, motion
from tsplat.viewer.settings import select_row, step_output, step_row
from tsplat.viewer.state import Loaded, Notice, Panel, Tick, ViewerState

Event = Key | Mouse | Resize | Focus | Tick | Notice | Loaded

MOTION_KEYS = {
    "w": "forward",
    "s": "back",
    "a": "left",
    "d": "right",
    "r": "up",
    "f": "down",
    "j": "yaw left",
    "k": "yaw right",
    "left": "yaw left",
    "right": "yaw right",
    "h": "pitch up",
    "l": "pitch down",
    "up": "pitch up",
    "down": "pitch down",
    "+": "zoom in",
    "=": "zoom in",
    "-": "zoom out",
    "_": "zoom out",
}
"""Keys that act as long as they are down; ``=`` and ``_`` are + and - with the other shift."""


def update(state: ViewerState, event: Event) -> ViewerState:
    """Return the state after ``event``; what means nothing here changes nothing."""
    match event:
        case Tick():
            return motion.tick(state, event)
        case Key():
            return _key(state, event)
        case Mouse():
            return _mouse(state, event)
        case Resize():
            return replace(state, size=event.size, screens=state.screens + 1, grabbed=None)
        case Focus():
            # Keys held while the window loses the keyboard will never be reported as released.
            return state if event.gained else replace(state, held=(), grabbed=None)
        case Notice():
            return replace(state, message=event.text)
        case Loaded():
            n, degree = event.splats, event.sh_degree
            return replace(state, total=n, kept=n, scene_degree=degree, message="loaded again")


def plain(name: str) -> str:
    """Return the name of a key without shift and as a small letter: W and w do the same."""
    return name.removeprefix("shift+").lower()


def _key(state: ViewerState, key: Key) -> ViewerState:
    name = plain(key.name)
    edit = _panel_keys(state).get(name)
    if key.action == "release":
        return motion.released(state, MOTION_KEYS[name]) if name in MOTION_KEYS else state
    if key.action == "press":
        state = replace(state, message="")
    if edit is not None:
        return edit(state)
    if name in MOTION_KEYS:
        return motion.pressed(state, MOTION_KEYS[name])
    if name in COMMANDS and key.action == "press":
        return COMMANDS[name](state)
    return state


def _panel_keys(state: ViewerState) -> Mapping[str, Callable[[ViewerState], ViewerState]]:
    if state.panel == "hud":
        return HUD_KEYS
    return HELP_KEYS if state.panel == "help" and not help.fits(state) else {}


def _mouse(state: ViewerState, mouse: Mouse) -> ViewerState:
    if mouse.action == "wheel":
        return motion.zoomed(state, mouse.wheel * motion.WHEEL_SECONDS)
    if mouse.action == "press" and mouse.button in ("left", "right"):
        button = "pan" if mouse.button == "right" or mouse.shift else "orbit"
        return replace(state, grabbed=(mouse.x, mouse.y, button))
    if mouse.action == "release":
        return replace(state, grabbed=None)
    if mouse.action == "drag" and state.grabbed:
        x, y, button = state.grabbed
        state = replace(state, grabbed=(mouse.x, mouse.y, button))
        return motion.dragged(state, mouse.x - x, mouse.y - y, pan=button == "pan")
    return state


def _toggle_mode(state: ViewerState) -> ViewerState:
    if state.mode == "orbit":
        return replace(state, mode="fly", auto_orbit=False, message="flying")
    return replace(state, mode="orbit", message="orbiting")


def _toggle_auto_orbit(state: ViewerState) -> ViewerState:
    return replace(state, mode="orbit", auto_orbit=not state.auto_orbit)


def _next_output(state: ViewerState) -> ViewerState:
    state = step_output(state, 1)
    return replace(state, message=f"output: {state.output}")


def _home(state: ViewerState) -> ViewerState:
    return replace(state, pose=state.start, held=(), auto_orbit=False)


def _panel(panel: Panel) -> Callable[[ViewerState], ViewerState]:
    # Keys held now may mean something else while the panel is open, so all of them go up.
    return lambda state: replace(state, panel="" if state.panel == panel else panel, held=(), scroll=0)


def _quit(state: ViewerState) -> ViewerState:
    return replace(state, running=False)


def _escape(state: ViewerState) -> ViewerState:
    return replace(state, panel="") if state.panel else _quit(state)


COMMANDS: dict[str, Callable[[ViewerState], ViewerState]] = {
    "space": _toggle_mode,
    "o": _toggle_auto_orbit,
    "z": _home,
    "home": _home,
    "u": lambda state: replace(state, ups=state.ups + 1),
    "m": _next_output,
    "tab": _panel("hud"),
    "?": _panel("help"),
    "p": lambda state: replace(state, pictures=state.pictures + 1),
    "q": _quit,
    "ctrl+c": _quit,
    "escape": _escape,
    "ctrl+r": lambda state: replace(state, reloads=state.reloads + 1),
    "ctrl+z": lambda state: replace(state, suspends=state.suspends + 1, held=()),
}
"""Keys that act once, when they go down."""

HUD_KEYS: dict[str, Callable[[ViewerState], ViewerState]] = {
    "up": lambda state: select_row(state, -1),
    "down": lambda state: select_row(state, 1),
    "left": lambda state: step_row(state, -1),
    "right": lambda state: step_row(state, 1),
}
"""Keys that mean something else while the HUD is open; they repeat when held."""

HELP_KEYS: dict[str, Callable[[ViewerState], ViewerState]] = {
    "up": lambda state: replace(state, scroll=max(0, state.scroll - 1)),
    "down": lambda state: replace(state, scroll=min(help.HEIGHT, state.scroll + 1)),
}
"""Likewise while the keys are shown on a screen too short for all of them."""
