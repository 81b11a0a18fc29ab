"""Shapes of text cells: which pixels of a cell each glyph lights, and how it is written.

A glyph's number is its pattern: bit i is pixel i of the cell, row by row from the top left. Only the ASCII
ramp is numbered by brightness. Source: The Unicode Standard 16.0, charts U+2580, U+2800, U+1CC00, U+1FB00.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

F32 = npt.NDArray[np.float32]

FULL_BLOCK = "\u2588"

QUADRANTS = " \u2598\u259d\u2580\u2596\u258c\u259e\u259b\u2597\u259a\u2590\u259c\u2584\u2599\u259f\u2588"

OCTANTS_ELSEWHERE = {
    0b00000001: "\U0001cea8", 0b00000010: "\U0001ceab", 0b01000000: "\U0001cea3", 0b10000000: "\U0001cea0",
    0b00010100: "\U0001fbe6", 0b00101000: "\U0001fbe7",
    0b00000011: "\U0001fb82", 0b00111111: "\U0001fb85", 0b11000000: "\u2582", 0b11111100: "\u2586",
}  # fmt: skip
"""Octants that have no name of their own, besides those that are quadrants: quarters and three quarters."""

BRAILLE_DOTS = (0, 3, 1, 4, 2, 5, 6, 7)
"""Bit of each pixel in U+2800: the fourth row came later."""

RAMP = {
    " ": 0.0, ".": 0.096, ":": 0.192, ";": 0.257, "*": 0.349, "=": 0.437, "v": 0.506, "n": 0.601, "a": 0.696,
    "S": 0.733, "E": 0.798, "&": 0.837, "#": 0.881, "R": 0.919, "@": 1.0,
}  # fmt: skip
"""How bright each glyph of the ASCII ramp is, from none to the brightest: its share of ink in DejaVu Sans Mono."""


@dataclass(frozen=True, eq=False, slots=True)
class Shape:
    """What a cell can show.

    Attributes
    ----------
    across, down : int
        Pixels of a cell.
    glyphs : tuple of str
        One character each, by number.
    lit : ndarray of float32, [glyphs, pixels]
        The share of the foreground in each pixel, 0 to 1; the rest is background.
    background : bool
        Whether cells choose their background; it is black where they do not.
    free : int
        Pixels that a pattern may light or not: all; or one less, where each glyph has one that lights the other
        pixels and stands for it with colours swapped; or 0, where patterns are not chosen.
    """

    across: int
    down: int
    glyphs: tuple[str, ...]
    lit: F32
    background: bool
    free: int

    @property
    def invertible(self) -> bool:
        """Whether a glyph that lights the other pixels, with colours swapped, shows the same."""
        return 0 < self.free < self.across * self.down


def shape(name: str) -> Shape:
    """Return a shape by the name of its encoder: octant, sextant, quadrant, half, braille or ascii."""
    if name == "ascii":
        ink = np.array(list(RAMP.values()), np.float32)
        return Shape(1, 2, tuple(RAMP), np.repeat(ink[:, None], 2, axis=1), background=False, free=0)
    across, down = {"half": (1, 2), "quadrant": (2, 2), "sextant": (2, 3)}.get(name, (2, 4))
    glyphs = {"half": _half, "quadrant": _quadrant, "sextant": _sextant, "octant": _octant, "braille": _braille}
    patterns = range(1 << across * down)
    lit = np.array([[pattern >> i & 1 for i in range(across * down)] for pattern in patterns], np.float32)
    return Shape(
        across,
        down,
        tuple(map(glyphs[name], patterns)),
        lit,
        background=name != "braille",
        free={"half": 0, "braille": 8}.get(name, across * down - 1),
    )


def _half(pattern: int) -> str:
    return _quadrant(0b0011 * (pattern & 1) | 0b1100 * (pattern >> 1))


def _quadrant(pattern: int) -> str:
    return QUADRANTS[pattern]


def _sextant(pattern: int) -> str:
    elsewhere = {0: " ", 0b010101: "\u258c", 0b101010: "\u2590", 0b111111: FULL_BLOCK}
    before = sum(other < pattern for other in elsewhere)
    return elsewhere.get(pattern) or chr(0x1FB00 + pattern - before)


def _octant(pattern: int) -> str:
    before = sum(_octant_elsewhere(other) is not None for other in range(pattern))
    return _octant_elsewhere(pattern) or chr(0x1CD00 + pattern - before)


def _octant_elsewhere(pattern: int) -> str | None:
    for quadrants in range(16):
        upper, lower = quadrants & 0b11, quadrants >> 2
        if pattern == upper * 0b0101 | lower * 0b01010000:
            return _quadrant(quadrants)
    return OCTANTS_ELSEWHERE.get(pattern)


def _braille(pattern: int) -> str:
    # A space is what a pattern without dots shows, and shorter.
    dots = sum(1 << dot for i, dot in enumerate(BRAILLE_DOTS) if pattern >> i & 1)
    return chr(0x2800 + dots) if dots else " "
