"""What callers hand over: numbers of Python's or NumPy's are taken, all else is one line that shows it.

A function whose callers expect another ``error`` than `OptionError` says so.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
import numpy.typing as npt

from tsplat.errors import LoadError, OptionError, TsplatError, shown

Call = TypeVar("Call", bound=Callable[..., Any])
F64 = npt.NDArray[np.float64]


def whole(
    name: str, value: object, low: int, high: int | None = None, error: type[TsplatError] = OptionError
) -> int:
    """Return a whole number from ``low`` to ``high``, or as large as it likes.

    Raises
    ------
    OptionError
        It is none.
    """
    number = value if type(value) is int else _lone(value, "iu")
    if number is None or number < low or (high is not None and number > high):
        expected = f"{low} {'or more' if high is None else f'to {high}'}"
        kind = "a whole number, " if number is None else ""
        raise error(f"{name} must be {kind}{expected}, got {shown(value)}")
    return int(number)


def real(
    name: str,
    value: object,
    expected: str = "a number",
    low: float = -math.inf,
    error: type[TsplatError] = OptionError,
) -> float:
    """Return a number that is at least ``low``; infinite ones are, nan is none.

    Raises
    ------
    OptionError
        It is none.
    """
    number = _lone(value, "iuf")
    if number is None or not number >= low:
        raise error(f"{name} must be {expected}, got {shown(value)}")
    return float(number)


def triple(name: str, values: object, *, finite: bool = True, error: type[TsplatError] = OptionError) -> F64:
    """Return three numbers as float64 [3]; without ``finite``, some may be infinite.

    Raises
    ------
    OptionError
        They are none, or nan.
    """
    array = numbers(values, "iuf")
    if array is None or array.shape != (3,) or not (np.isfinite(array) if finite else ~np.isnan(array)).all():
        raise error(f"{name} must be three {'finite ' if finite else ''}numbers, got {shown(values)}")
    return array.astype(np.float64)


def function(name: str, value: Call) -> Call:
    """Return what is to be called.

    Raises
    ------
    OptionError
        It cannot be.
    """
    if not callable(value):
        raise OptionError(f"{name} must be a function, got {shown(value)}")
    return value


def path(value: object) -> Path:
    """Return a path.

    Raises
    ------
    OptionError
        It is none.
    LoadError
        No file can be called that.
    """
    if not isinstance(value, (str, os.PathLike)) or not isinstance(os.fspath(value), str):
        raise OptionError(f"path must be a str or a Path, got {shown(value)}")
    try:
        unusable = b"\0" in os.fsencode(value)
    except ValueError:  # half of a character
        unusable = True
    if unusable:
        raise LoadError(os.fspath(value), "is no name that a file can have; check the path")
    return Path(value)


def _lone(value: object, kinds: str) -> int | float | None:
    array = numbers(value, kinds)
    return None if array is None or array.ndim else cast("int | float", array.item())


def numbers(values: object, kinds: str) -> npt.NDArray[np.number] | None:
    """Return an array of numbers of these kinds, see `numpy.dtype.kind`, or None where what is given is none."""
    try:
        array = np.asarray(values)
    except (ValueError, TypeError):  # lists of several lengths
        return None
    return array if array.dtype.kind in kinds else None
