"""JSON of a stranger, parsed: the one place where it is, so that its depth, its numbers and its size are bounded.

Each reader bounds the bytes of its file by what they can mean; parsed, they may be thirty times as many.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import TypeVar

from tsplat.errors import CorruptFileError

Kind = TypeVar("Kind")

VALUES_MAX = 1 << 21
"""What a scene or a list of cameras names and counts is less; parsed, so many take a hundred megabytes or two."""

DIGITS_MAX = 4000
"""Of a whole number; longer ones are beyond every float64, and Python refuses to read them, or takes long."""

BEFORE_VALUES = b"[", b"{", b":", b","
"""What a value follows, but for the first; inside of texts they count as well, which hold few of them."""


def parse_json(
    text: bytes, kind: type[Kind], expected: str, corrupt: Callable[[str, int | None], CorruptFileError]
) -> Kind:
    """Return the list, the object, or whatever of a ``kind`` a file holds.

    Parameters
    ----------
    text : bytes
        Of a size that suits the file.
    kind : type
        ``list`` or ``dict``; ``object`` for any.
    expected : str
        What the file should hold, for messages.
    corrupt : callable
        Makes the error of a problem, and of the byte where it lies if that is known.

    Returns
    -------
    list or dict
        Whole numbers of too many digits are infinite ones; NaN and Infinity are what they say.

    Raises
    ------
    CorruptFileError
        It is no JSON, too much of it, or of another kind.
    """
    if sum(map(text.count, BEFORE_VALUES)) > VALUES_MAX:
        raise corrupt(f"holds more than {VALUES_MAX} values, expected {expected}", None)
    try:
        content = json.loads(text, parse_int=_whole)
    except (ValueError, RecursionError) as error:
        offset = error.pos if isinstance(error, json.JSONDecodeError) else None
        raise corrupt(f"is not JSON, expected {expected}", offset) from error
    if not isinstance(content, kind):
        raise corrupt(f"holds a JSON {type(content).__name__}, expected {expected}", None)
    return content


def _whole(digits: str) -> int | float:
    if len(digits) <= DIGITS_MAX:
        return int(digits)
    return -math.inf if digits.startswith("-") else math.inf
