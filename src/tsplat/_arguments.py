"""The arguments of a kernel as eight bytes each: an array's address, a number, nothing for None.

A named tuple's fields follow each other as if they were arguments. Beside the bytes there is a description of
the types, which says what machine code they are for.
"""

from __future__ import annotations

import ctypes
import struct
from typing import Any, NamedTuple

import numpy as np

ENTRY_TYPE = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
"""What takes them: machine code that is told where they are and where its result goes, and returns 0, or 1 where
it failed."""

WORD = 8
"""Bytes of an argument."""

_GOOD = 0x101
"""Flags of an array that lies in memory in the order of its indices, each value where the processor wants it."""

_ALIGNED = 0x100

_FORMATS = {int: "q", bool: "q", float: "d", np.int64: "q", np.uint64: "Q", np.float64: "d", np.float32: "f4x"}

Types = tuple[Any, ...]


class Arguments(NamedTuple):
    """What `flat` makes of arguments: their types, flat as well, and their values; arrays by their addresses."""

    types: Types
    values: list[Any]


class Known(NamedTuple):
    """What `flat` makes of some fields. Twenty arrays that the last frame has driven out of the caches take longer
    to look at than a kernel to call."""

    fields: int
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


def known(fields: tuple[Any, ...]) -> Known:
    """Look at fields that many jobs will end with."""
    return Known(len(fields), *flat(fields))


def flat_job(job: Any, rest: Known) -> Arguments:
    """Return what `flat` does for a worker and its job, whose last fields are known already."""
    types: list[Any] = [int, type(job), len(job)]
    values: list[Any] = [0]
    for field in job[: len(job) - rest.fields]:
        _add(field, types, values)
    return Arguments((*types, *rest.types), values + rest.values)


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
