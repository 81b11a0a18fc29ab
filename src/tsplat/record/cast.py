"""Asciicast v3: what was written to a terminal, and when.

Source: https://docs.asciinema.org/manual/asciicast/v3/
"""

from __future__ import annotations

import codecs
import json
from typing import Any, BinaryIO

from tsplat.encode import ENCODERS, FALLBACK_CELL, PICTURES, Encoder
from tsplat.export import Frames, Progress
from tsplat.terminal.modes import SCREEN

CELLS = tuple(name for name in ENCODERS if name not in PICTURES)
"""Names of the encoders that write text; players of asciicasts draw no pictures."""

FRESH, HOME = SCREEN[0] + b"\x1b[2J", b"\x1b[H"


class Cast:
    """Writes one recording, event by event; times are seconds since its start and never go back.

    Parameters
    ----------
    file : binary file
        Open for writing, empty.
    columns, rows : int
        Size of the terminal at the start.
    **about
        More for the header, such as ``title``.
    """

    def __init__(self, file: BinaryIO, columns: int, rows: int, **about: Any) -> None:
        self._file, self._milliseconds = file, 0
        # A write may end within a character; its bytes wait for the rest.
        self._decoder = codecs.getincrementaldecoder("utf-8")("replace")
        self._write({"version": 3, "term": {"cols": columns, "rows": rows, "type": "xterm-256color"}, **about})

    def output(self, seconds: float, screen: bytes) -> None:
        """Note what was written to the terminal."""
        if text := self._decoder.decode(screen):
            self._event(seconds, "o", text)

    def resize(self, seconds: float, columns: int, rows: int) -> None:
        """Note that the terminal has another size."""
        self._event(seconds, "r", f"{columns}x{rows}")

    def end(self, seconds: float) -> None:
        """Give the screen back, and note that all went well."""
        if rest := self._decoder.decode(b"", final=True):
            self._event(seconds, "o", rest)
        self.output(seconds, SCREEN[1])
        self._event(seconds, "x", "0")

    def _event(self, seconds: float, kind: str, text: str) -> None:
        # Intervals are between rounded times, so that their sum does not drift.
        now = max(self._milliseconds, round(1000 * seconds))
        self._write([(now - self._milliseconds) / 1000, kind, text])
        self._milliseconds = now

    def _write(self, line: object) -> None:
        self._file.write(json.dumps(line, ensure_ascii=False).encode() + b"\n")


def write_orbit(
    file: BinaryIO,
    frames: Frames,
    encoder: Encoder,
    size: tuple[int, int],
    fps: int,
    *,
    title: str,
    progress: Progress = lambda _: None,
) -> None:
    """Write frames as text cells.

    Parameters
    ----------
    file : binary file
        Open for writing, empty.
    frames : sequence of uint8 [H, W, 3]
        What is shown, one after another.
    encoder : Encoder
        A new one, of text cells: players draw no pictures.
    size : tuple of 2 ints
        Columns and rows.
    fps : int
        Frames a second.
    title : str
        What players call it.
    progress : callable, optional
        Told the fraction that is done.
    """
    cast = Cast(file, *size, title=title)
    for index in range(len(frames)):
        encoded = encoder.encode(frames[index], *size, FALLBACK_CELL)
        cast.output(index / fps, (HOME if index else FRESH + HOME) + encoded.draw)
        progress((index + 1) / len(frames))
    cast.end(len(frames) / fps)
