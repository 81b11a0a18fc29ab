"""The panel of keys; what it says depends on the mode."""

from __future__ import annotations

from tsplat.viewer.spans import Span, line
from tsplat.viewer.state import ViewerState

ORBIT = (
    ("drag", "turn the scene"),
    ("right or shift drag", "pan"),
    ("wheel, + -", "zoom"),
    ("J K or ← →", "go round to the left, right"),
    ("H L or ↑ ↓", "go up, down over the scene"),
    ("W S  A D  R F", "pan in and out, sideways, up and down"),
    ("Space", "fly instead"),
)
FLY = (
    ("drag", "look around"),
    ("right or shift drag", "slide"),
    ("wheel, + -", "near or leave what is ahead"),
    ("J K or ← →", "look left, right"),
    ("H L or ↑ ↓", "look up, down"),
    ("W S  A D  R F", "fly ahead and back, sideways, up and down"),
    ("Space", "orbit instead"),
)
COMMON = (
    ("O", "orbit by itself, on and off"),
    ("Z or Home", "back to the start view"),
    ("U", "something else is up: the next of six"),
    ("M", "next output mode"),
    ("Tab", "settings and measurements"),
    ("P", "save this view as a PNG"),
    ("?", "these keys"),
    ("Ctrl-R", "load a .tsplat again that changed on disk"),
    ("Ctrl-Z", "suspend"),
    ("q, Ctrl-C, Esc", "quit; Esc closes a panel first"),
)

HEIGHT = 2 + len(ORBIT) + len(COMMON)
"""Rows of the whole panel, with its title and an empty row at the end."""

KEYS_WIDTH, WIDTH = 20, 66


def fits(state: ViewerState) -> bool:
    """Return whether the screen shows the whole panel; where it does not, it scrolls."""
    return state.size.rows >= HEIGHT


def help_spans(state: ViewerState) -> list[Span]:
    """Return the panel of keys, in the middle of the screen."""
    columns, rows = state.size.columns, state.size.rows
    width, height = min(WIDTH, columns), min(HEIGHT, rows)
    top, left = (rows - height) // 2, (columns - width) // 2
    title = " Orbiting: keys" if state.mode == "orbit" else " Flying: keys"
    if not fits(state):
        title += "   (↑ ↓ scroll)"
    spans = line(top, left, [(title, "title")], width)
    keys = (*(ORBIT if state.mode == "orbit" else FLY), *COMMON)
    shown = height - 1
    first = min(state.scroll, max(0, len(keys) - shown))
    narrow = min(KEYS_WIDTH, width // 2)
    for offset in range(shown):
        key, meaning = keys[first + offset] if first + offset < len(keys) else ("", "")
        pieces = [(f" {key:<{narrow}} ", "value"), (meaning, "label")]
        spans += line(top + 1 + offset, left, pieces, width)
    return spans
