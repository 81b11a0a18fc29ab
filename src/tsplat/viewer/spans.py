"""Text at fixed places on the screen, clipped to it, and the bytes that put it there."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

U8 = npt.NDArray[np.uint8]
RGB = tuple[int, int, int]

STYLES: dict[str, tuple[str, int, RGB]] = {
    "label": ("38;5;250", 235, (38, 38, 38)),
    "value": ("1;38;5;231", 235, (38, 38, 38)),
    "selected": ("1;38;5;231", 25, (0, 95, 175)),
    "title": ("1;38;5;153", 235, (38, 38, 38)),
    "thumb": ("38;5;110", 235, (38, 38, 38)),
    "rule": ("38;5;239", 233, (18, 18, 18)),
    "fact": ("38;5;246", 233, (18, 18, 18)),
    "figure": ("38;5;252", 233, (18, 18, 18)),
    "badge": ("1;38;5;231", 235, (38, 38, 38)),
    "message": ("1;38;5;231", 25, (0, 95, 175)),
}
"""Letters, and the background by its number in the 256-colour palette and as the red, green and blue that
terminals show for it; none of the 16 colours that themes change."""

PANEL_OPACITY = 0.85
"""Of a panel that is part of the picture; the scene still shows through."""

Piece = tuple[str, str]
"""Text and the name of its style."""


class Span(NamedTuple):
    """A run of text in one style; row and column count from 0 at the top left."""

    row: int
    column: int
    text: str
    style: str


def printable(text: str) -> str:
    """Return ``text`` with every control character and line end shown as a question mark."""
    return "".join(character if character.isprintable() else "?" for character in text)


def width_of(text: str) -> int:
    """Return how many cells a text covers."""
    if text.isascii():
        return len(text)
    from rich.cells import cell_len

    return cell_len(text)


def fitted(text: str, width: int) -> str:
    """Return ``text`` cut or padded to exactly ``width`` cells; a cut one ends in an ellipsis."""
    if text.isascii():
        return f"{text:<{width}}" if len(text) <= width else f"{text[: max(0, width - 1)]}…"[:width]
    from rich.cells import cell_len, set_cell_size

    if cell_len(text) <= width:
        return set_cell_size(text, width)
    return set_cell_size(text, max(0, width - 1)) + "…"[:width]


def line(row: int, column: int, pieces: Sequence[Piece], width: int) -> list[Span]:
    """Return the spans of one line of a panel, cut and filled to ``width`` cells in the last style."""
    spans = []
    end = column + width
    for index, (text, style) in enumerate(pieces):
        room = end - column
        cells = room if index == len(pieces) - 1 else min(room, width_of(printable(text)))
        if cells > 0:
            spans.append(Span(row, column, fitted(printable(text), cells), style))
        column += cells
    return spans


def clipped(spans: Iterable[Span], columns: int, rows: int) -> list[Span]:
    """Return what of the spans lies on a screen of this size."""
    kept = []
    for span in spans:
        room = columns - span.column
        if 0 <= span.row < rows and span.column >= 0 and room > 0:
            text = span.text if width_of(span.text) <= room else fitted(span.text, room)
            kept.append(span._replace(text=text))
    return kept


def painted(spans: Iterable[Span], *, backgrounds: bool = True) -> bytes:
    """Return the bytes that draw the spans, colours reset at the end; without backgrounds, letters only."""
    parts = []
    for row, column, text, style in spans:
        letters, background, _ = STYLES[style]
        colors = f"0;{letters};48;5;{background}" if backgrounds else f"0;{letters}"
        parts.append(f"\x1b[{row + 1};{column + 1}H\x1b[{colors}m{text}")
    return "".join([*parts, "\x1b[0m"]).encode() if parts else b""


def shaded(frame: U8, spans: Iterable[Span], columns: int, rows: int) -> U8:
    """Return a frame that covers ``columns`` x ``rows`` cells, with the backgrounds of the spans blended in."""
    frame = frame.copy()
    down, across = len(frame) / rows, frame.shape[1] / columns
    for row, column, text, style in spans:
        top, bottom = round(row * down), round((row + 1) * down)
        left, right = round(column * across), round((column + width_of(text)) * across)
        panel = frame[top:bottom, left:right]
        panel[:] = (1.0 - PANEL_OPACITY) * panel + PANEL_OPACITY * np.array(STYLES[style][2], np.float32)
    return frame


def covered(spans: Iterable[Span], columns: int, rows: int) -> npt.NDArray[np.bool_]:
    """Return which cells of a picture of ``columns`` x ``rows`` have text over them, [rows, columns]."""
    under = np.zeros((rows, columns), bool)
    for row, column, text, _ in spans:
        if row < rows:
            under[row, column : column + width_of(text)] = True
    return under


def erased(old: Iterable[Span], new: Iterable[Span], colors: bytes = b"\x1b[0m") -> bytes:
    """Return the bytes that blank every cell that ``old`` covered and ``new`` does not, in these colours."""
    stale = _cells(old) - _cells(new)
    # One run of cells each; a run starts where the cell on its left is not stale.
    starts = sorted((row, column) for row, column in stale if (row, column - 1) not in stale)
    parts = []
    for row, column in starts:
        end = column
        while (row, end) in stale:
            end += 1
        parts.append(f"\x1b[{row + 1};{column + 1}H\x1b[{end - column}X")
    return colors + "".join(parts).encode() + b"\x1b[0m" if parts else b""


def _cells(spans: Iterable[Span]) -> set[tuple[int, int]]:
    return {(span.row, span.column + cell) for span in spans for cell in range(width_of(span.text))}
