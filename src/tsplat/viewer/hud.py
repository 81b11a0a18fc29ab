"""The text over the picture: settings with what was measured, frame rate, message. Pure layout."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from tsplat.viewer.help import help_spans
from tsplat.viewer.settings import SETTINGS
from tsplat.viewer.spans import Piece, Span, clipped, line, printable, width_of
from tsplat.viewer.state import ViewerState

WIDTH = 44
LABEL_WIDTH = 16
FACT_LABEL_WIDTH = 10
LEAST_SETTINGS = 5
"""Rows of settings kept before the facts below them get any."""


@dataclass(frozen=True, slots=True)
class Measured:
    """What the loop knows and the state does not.

    Attributes
    ----------
    fps : float
        Frames per second, 0 before it is known.
    visible : int
        Splats that touch the image.
    width, height : int
        Size of the rendered frame in pixels.
    stage_ms : mapping of str to float
        Milliseconds by stage of a frame, rendering first.
    terminal : str
        What the terminal calls itself.
    protocol : str
        What was detected of it.
    detail : str
        What there is to say of these splats: that some are merged, or will be; often nothing.
    """

    fps: float = 0.0
    visible: int = 0
    width: int = 0
    height: int = 0
    stage_ms: Mapping[str, float] = field(default_factory=dict)
    terminal: str = ""
    protocol: str = ""
    detail: str = ""


def layout(state: ViewerState, measured: Measured) -> list[Span]:
    """Return all text over the picture, clipped to the screen; later spans lie above earlier ones."""
    columns, rows = state.size.columns, state.size.rows
    spans = []
    badge = _badge(measured)
    covered = min(WIDTH, columns) if state.panel == "hud" else 0
    if columns - len(badge) >= covered:
        spans.append(Span(0, columns - len(badge), badge, "badge"))
    if state.panel == "hud":
        spans += hud_spans(state, measured)
    elif state.panel == "help":
        spans += help_spans(state)
    if state.message:
        text = printable(f" {state.message} ")
        spans += line(rows - 1, 0, [(text, "message")], min(columns, width_of(text)))
    return clipped(spans, columns, rows)


def _badge(measured: Measured) -> str:
    fps = f"{measured.fps:.0f}" if measured.fps >= 9.5 else f"{measured.fps:.1f}"
    detail = f", {measured.detail}" if measured.detail else ""
    return f" {fps} fps | {measured.visible:,} splats{detail} "


def hud_spans(state: ViewerState, measured: Measured) -> list[Span]:
    """Return the HUD's panel at the top left; the settings scroll where the screen is too short."""
    width, height = min(WIDTH, state.size.columns), max(1, state.size.rows - 1)
    facts = _facts(state, measured, width)
    shown = min(len(SETTINGS), max(height - len(facts), min(height, LEAST_SETTINGS)))
    # The selected row stays in the middle until an end of the table is in view.
    first = min(max(0, state.row - shown // 2), len(SETTINGS) - shown)
    spans = []
    for place in range(shown):
        scrollbar = _thumb(place, first, shown)
        spans += line(place, 0, _setting(state, first + place, scrollbar, width), width)
    below = facts[: height - shown]
    if height - shown > len(facts):
        spans += line(shown, 0, [("─" * width, "rule")], width)
        shown += 1
    for place, pieces in enumerate(below):
        spans += line(shown + place, 0, pieces, width)
    return spans


def _setting(state: ViewerState, row: int, scrollbar: str, width: int) -> list[Piece]:
    setting = SETTINGS[row]
    room = max(1, width - LABEL_WIDTH - 6)
    value = f"{setting.show(state):<{room}}"[:room]
    label = f" {setting.label:<{LABEL_WIDTH}}"
    if row == state.row:
        text = f"◂ {value.rstrip()} ▸"
        return [
            (f"{label}{text:<{room + 4}}", "selected"),
            (scrollbar, "thumb" if scrollbar.strip() else "selected"),
        ]
    return [(label, "label"), (f"  {value}  ", "value"), (scrollbar, "thumb")]


def _thumb(place: int, first: int, shown: int) -> str:
    if shown == len(SETTINGS):
        return " "
    # The thumb covers the part of the bar that the visible rows are of the table.
    start, end = first * shown / len(SETTINGS), (first + shown) * shown / len(SETTINGS)
    return "┃" if start <= place + 0.5 < end else " "


def _facts(state: ViewerState, measured: Measured, width: int) -> list[list[Piece]]:
    pose = state.pose
    cell = "{} x {} px".format(*state.size.cell_size) if all(state.size.cell_size) else "unknown"
    eye = "  ".join(_short(value) for value in pose.eye)
    view = f"yaw {math.degrees(pose.yaw):.0f}° pitch {math.degrees(pose.pitch):.0f}° at "
    total = sum(measured.stage_ms.values())
    stages = [f"{name} {ms:.1f}" for name, ms in measured.stage_ms.items()] + [f"all {total:.1f}"]
    room = width - FACT_LABEL_WIDTH - 2
    rows = [
        ("picture", f"{measured.width} x {measured.height} px, cell {cell}"),
        ("terminal", measured.terminal or "unknown"),
        ("detected", measured.protocol),
        *zip(("frame, ms", "", ""), _filled(stages, room), strict=False),
        ("eye", eye),
        (state.mode, view + _short(pose.distance)),
    ]
    return [[(f" {label:<{FACT_LABEL_WIDTH}}", "fact"), (text, "figure")] for label, text in rows]


def _filled(items: list[str], width: int) -> list[str]:
    lines: list[str] = []
    for item in items:
        if lines and len(lines[-1]) + 2 + len(item) <= width:
            lines[-1] += f"  {item}"
        else:
            lines.append(item)
    return lines


def _short(value: float) -> str:
    return f"{value:.4g}"
