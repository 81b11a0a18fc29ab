"""The rows of the HUD that can be changed: one table of how each is shown and how it steps."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from tsplat.rendering import ANTIALIAS, SIGMA_EXTENT
from tsplat.viewer.state import ViewerState

Show = Callable[[ViewerState], str]
Step = Callable[[ViewerState, int], ViewerState]

KEPT_PERCENT = (1, 2, 3, 5, 7, 10, 15, 20, 30, 40, 50, 60, 70, 80, 90, 100)
DENSITIES = (0.25, 0.5, 1.0, 2.0, 3.0)
FOVS = tuple(float(degrees) for degrees in range(10, 121, 5))
MOVES = (0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0, 1.5, 2.0, 3.0, 5.0)
TURNS = (5.0, 10.0, 20.0, 30.0, 45.0, 60.0, 90.0, 120.0, 180.0, 360.0)
ZOOMS = (1.1, 1.25, 1.5, 2.0, 3.0, 4.0, 8.0)
EPS2D = (0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.75, 1.0, 1.5, 2.0, 4.0)
ALPHA_PARTS = (1020, 765, 510, 255, 128, 85, 64, 51, 32, 25, 16, 10, 5)
EXTENTS = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, SIGMA_EXTENT, 4.0, 5.0)
SATURATIONS = tuple(step / 10 for step in range(21))


@dataclass(frozen=True, slots=True)
class Setting:
    """One row: its label, its value as text with the unit, and the state one step up or down."""

    label: str
    show: Show
    step: Step


def stepped(ladder: Sequence[float], value: float, by: int) -> float:
    """Return the next value of an ascending ladder, above (``by`` 1) or below (-1); the ends hold."""
    # The tolerance lets a value that is on the ladder but for rounding count as being on it.
    room = 1e-3 * abs(value)
    if by > 0:
        index = min(bisect_right(ladder, value + room), len(ladder) - 1)
        return max(ladder[index], value)
    index = max(bisect_left(ladder, value - room) - 1, 0)
    return min(ladder[index], value)


def cycled(values: Sequence[Any], value: Any, by: int) -> Any:
    """Return the value after (``by`` 1) or before (-1) this one, around the end."""
    index = values.index(value) if value in values else 0
    return values[(index + by) % len(values)]


def _field(ladder: Sequence[float], name: str) -> Step:
    def step(state: ViewerState, by: int) -> ViewerState:
        changed: dict[str, Any] = {name: stepped(ladder, getattr(state, name), by)}
        return replace(state, **changed)

    return step


def _option(ladder: Sequence[float], name: str) -> Step:
    def step(state: ViewerState, by: int) -> ViewerState:
        changed: dict[str, Any] = {name: stepped(ladder, getattr(state.options, name), by)}
        return replace(state, options=replace(state.options, **changed))

    return step


def _speed(ladder: Sequence[float], name: str) -> Step:
    def step(state: ViewerState, by: int) -> ViewerState:
        value = stepped(ladder, getattr(state.speeds, name), by)
        return replace(state, speeds=replace(state.speeds, **{name: value}))

    return step


def _step_kept(state: ViewerState, by: int) -> ViewerState:
    ladder = sorted({max(1, round(state.total * percent / 100)) for percent in KEPT_PERCENT})
    if not state.total or state.on_disk:
        return state
    return replace(state, kept=int(stepped(ladder, state.kept, by)))


def _step_sh(state: ViewerState, by: int) -> ViewerState:
    degree = min(state.options.sh_degree, state.scene_degree) + by
    degree = min(max(degree, 0), state.scene_degree)
    return replace(state, options=replace(state.options, sh_degree=degree))


def _step_antialias(state: ViewerState, by: int) -> ViewerState:
    return replace(state, options=replace(state.options, antialias=cycled(ANTIALIAS, state.options.antialias, by)))


def step_output(state: ViewerState, by: int) -> ViewerState:
    """Return the state with the next output this terminal can show."""
    return replace(state, output=cycled(state.outputs, state.output, by))


def _step_threads(state: ViewerState, by: int) -> ViewerState:
    threads = min(max((state.options.threads or state.threads) + by, 1), state.threads)
    return replace(state, options=replace(state.options, threads=threads))


def _step_alpha(state: ViewerState, by: int) -> ViewerState:
    return _option(sorted(1.0 / parts for parts in ALPHA_PARTS), "alpha_min")(state, by)


def _show_kept(state: ViewerState) -> str:
    if state.on_disk:
        return f"{state.kept:,} (as stored)"
    percent = 100.0 * state.kept / max(1, state.total)
    return f"{state.kept:,} ({percent:.0f} %)" if percent >= 1.0 else f"{state.kept:,} (< 1 %)"


def _show_threads(state: ViewerState) -> str:
    return f"{state.options.threads or state.threads} of {state.threads}"


def _toggle_raw(state: ViewerState, by: int) -> ViewerState:
    return replace(state, raw_opacity=not state.raw_opacity) if by and not state.on_disk else state


def _show_opacity(state: ViewerState) -> str:
    if state.on_disk:
        return "as stored"
    return "raw" if state.raw_opacity else "sigmoid"


def _show_move(state: ViewerState) -> str:
    return f"{state.speeds.move:g} {'distances' if state.mode == 'orbit' else 'radii'}/s"


SETTINGS: tuple[Setting, ...] = (
    Setting("splats kept", _show_kept, _step_kept),
    Setting("opacity", _show_opacity, _toggle_raw),
    Setting("SH degree", lambda state: str(min(state.options.sh_degree, state.scene_degree)), _step_sh),
    Setting("antialias", lambda state: state.options.antialias, _step_antialias),
    Setting("output", lambda state: state.output, step_output),
    Setting("pixel density", lambda state: f"{state.density:g} x", _field(DENSITIES, "density")),
    Setting("threads", _show_threads, _step_threads),
    Setting("field of view", lambda state: f"{state.fov_y:g}°", _field(FOVS, "fov_y")),
    Setting("move speed", _show_move, _speed(MOVES, "move")),
    Setting("turn speed", lambda state: f"{state.speeds.turn:g}°/s", _speed(TURNS, "turn")),
    Setting("zoom speed", lambda state: f"{state.speeds.zoom:g} x/s", _speed(ZOOMS, "zoom")),
    Setting("eps2d", lambda state: f"{state.options.eps2d:.2f} px²", _option(EPS2D, "eps2d")),
    Setting("alpha threshold", lambda state: f"1/{1.0 / state.options.alpha_min:.0f}", _step_alpha),
    Setting(
        "sigma extent", lambda state: f"{state.options.sigma_extent:.2f} sigma", _option(EXTENTS, "sigma_extent")
    ),
    Setting("saturation", lambda state: f"{100 * state.saturation:.0f} %", _field(SATURATIONS, "saturation")),
)


def step_row(state: ViewerState, by: int) -> ViewerState:
    """Return the state with the value of the selected row one step up or down."""
    return SETTINGS[state.row].step(state, by)


def select_row(state: ViewerState, by: int) -> ViewerState:
    """Return the state with another row selected, around the ends."""
    return replace(state, row=(state.row + by) % len(SETTINGS))
