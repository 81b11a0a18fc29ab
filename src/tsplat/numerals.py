"""Text to numbers, for what people and their environments say: ASCII digits, finite, no larger than is meant.

Python's own `int` and `float` take more: digits of every script, underscores, nan and inf, and as many digits as
there are; `str.isdigit` says yes to a superscript that `int` refuses.
"""

from __future__ import annotations

import math
import re
from collections.abc import MutableMapping

LARGEST_WHOLE = 10**12 - 1
"""Beyond any count of splats or frames, and well within what kernels count with."""

LARGEST = 3.4e38
"""What a float32 holds, as scenes do."""

MOST_COLUMNS = 1000
"""Of printed pictures and tables."""

_WHOLE = re.compile(r"[+-]?[0-9]{1,18}")
_FLOAT = re.compile(r"[+-]?(?:[0-9]{1,400}(?:\.[0-9]{0,400})?|\.[0-9]{1,400})(?:[eE][+-]?[0-9]{1,4})?")


def whole(text: str) -> int | None:
    """Return a whole number, or None where the text is none."""
    number = int(text) if _WHOLE.fullmatch(text) else None
    return number if number is not None and abs(number) <= LARGEST_WHOLE else None


def finite(text: str) -> float | None:
    """Return a finite number, or None where the text is none."""
    number = float(text) if _FLOAT.fullmatch(text) else math.nan
    return number if abs(number) <= LARGEST else None


def columns(environment: MutableMapping[str, str]) -> int | None:
    """Return how many columns the environment wants printed, or None where it does not say."""
    number = whole(environment.get("COLUMNS", ""))
    return number if number is not None and 1 <= number <= MOST_COLUMNS else None


def drop_wrong_sizes(environment: MutableMapping[str, str]) -> None:
    """Take sizes out of an environment that are none: libraries that print tables believe what is there."""
    for name in ("COLUMNS", "LINES", "TERMINAL_WIDTH", "JUPYTER_COLUMNS", "JUPYTER_LINES"):
        number = whole(environment.get(name, "1"))
        if number is None or not 1 <= number <= MOST_COLUMNS:
            del environment[name]
