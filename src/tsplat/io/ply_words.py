"""Numbers as text: what C and Windows print for nan and inf, beside what Python reads."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

_NAN = re.compile(rb"[+-]?(nan|ind|[qs]nan)(\([a-z0-9_]*\))?")
_INF = re.compile(rb"([+-]?)1\.#(inf|j)0*")
_OTHER = re.compile(rb"[+-]?1\.#[a-z]+[0-9]*")
"""What Windows made of a nan: 1.#QNAN, -1.#IND00, and 1.#R where it was rounded."""


def number(word: bytes) -> float:
    """Return the number of a word.

    Raises
    ------
    ValueError
        It is none.
    """
    try:
        return float(word)
    except ValueError:
        lower = word.lower()
        if infinite := _INF.fullmatch(lower):
            return -math.inf if infinite[1] == b"-" else math.inf
        if _NAN.fullmatch(lower) or _OTHER.fullmatch(lower):
            return math.nan
        raise


def numbers(lines: Sequence[Sequence[bytes]]) -> list[list[float]]:
    """Return the numbers of some rows.

    Raises
    ------
    ValueError
        There is a word that is none; see `first_other`.
    """
    try:
        return [[*map(float, words)] for words in lines]
    except ValueError:
        return [[*map(number, words)] for words in lines]


def first_other(lines: Sequence[Sequence[bytes]]) -> tuple[int, bytes]:
    """Return the first word that is no number, and in which of the rows it is; there is one."""
    for row, words in enumerate(lines):
        for word in words:
            try:
                number(word)
            except ValueError:
                return row, word
    raise AssertionError("every word is a number")
