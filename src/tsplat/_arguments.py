"""The arguments of a kernel as eight bytes each: an array's address, a number, nothing for None.

A named tuple's fields follow each other as if they were arguments. Beside the bytes there is a description of
the types, which says what machine code they are for.
"""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

import numpy as np

_GOOD = 0x101
"""Flags of an array that lies in memory in the order of its indices, each value where the processor wants it."""

_ALIGNED = 0x100

_FORMATS = {int: "q", bool: "q", float: "d", np.int64: "q", np.uint64: "Q", np.float64: "d", np.float32: "f4x"}

Types = tuple[Any, ...]


class Arguments(NamedTuple):
    """What `flat` makes of arguments: their types, flat as well, and their values; arrays by their addresses."""

    types: Types
    values: list[Any]


def flat(arguments: tuple[Any, ...]) -> Arguments:
    """Return the types and the values of arguments, which must live as long as the values are used.

    Raises
    ------
    TypeError
        No kernel takes such an argument.
    """
    types: list[Any] = []
    values: list[Any] = []
    for argument in arguments:
        _add(argument, types, values)
    return Arguments(tuple(types), values)


def _add(argument: Any, types: list[Any], values: list[Any]) -> None:
    kind = type(argument)
    if kind is np.ndarray:
        types += argument.dtype, argument.ndim, _layout(argument)
        values.append(id(argument))
    elif kind in _FORMATS:
        types.append(kind)
        values.append(argument)
    elif argument is None:
        types.append(None)
    elif isinstance(argument, tuple):
        types += kind, len(argument)
        for each in argument:
            _add(each, types, values)
    else:
        raise TypeError(f"a kernel takes arrays, numbers and tuples of them, got {kind.__qualname__}")


def _layout(array: np.ndarray[Any, Any]) -> str:
    flags = array.flags.num
    if flags & _GOOD == _GOOD:
        return "C"
    if not flags & _ALIGNED:
        raise TypeError("a kernel takes aligned arrays; make a copy of it")
    return "A"


def packing(types: Types) -> struct.Struct:
    """Return what makes bytes of values of these types."""
    formats = ("q" if isinstance(each, np.dtype) else _FORMATS.get(each, "") for each in types)
    return struct.Struct("=" + "".join(formats))


def described(types: Types) -> str:
    """Return a name for types that is the same in every process."""
    return " ".join(each.__qualname__ if isinstance(each, type) else str(each) for each in types)
