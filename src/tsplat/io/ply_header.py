"""The header of a PLY file: which elements it holds, their columns, and where the first one starts.

Source: Turk 1994, *The PLY Polygon File Format*.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from tsplat.errors import CorruptFileError, shown

MAGIC = (b"ply\n", b"ply\r\n")
MAX_HEADER = 1 << 18
"""Bytes searched for ``end_header``: a hundred times what splat files need, and quick to read."""

MAX_ELEMENTS = 100
"""Splat files have three at most; a hostile header would make the checks slow."""

MAX_COLUMNS = 1000
"""Properties of one element: splats have 62, and a hostile header would make the checks slow."""

BYTE_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}

_TYPES = {
    ("char", "int8"): "i1",
    ("uchar", "uint8"): "u1",
    ("short", "int16"): "i2",
    ("ushort", "uint16"): "u2",
    ("int", "int32"): "i4",
    ("uint", "uint32"): "u4",
    ("float", "float32"): "f4",
    ("double", "float64"): "f8",
}
SCALARS = {name: code for names, code in _TYPES.items() for name in names}

_Fault = Callable[[str], CorruptFileError]


@dataclass(frozen=True, slots=True)
class Property:
    """One column: its name, NumPy type code, and for a list the type code of its length."""

    name: str
    code: str
    length_code: str | None = None

    @property
    def least_bytes(self) -> int:
        """Bytes that one row has at least: an empty list is only its length."""
        return np.dtype(self.length_code or self.code).itemsize


@dataclass(frozen=True, slots=True)
class Element:
    """A table: its name, its number of rows and its columns."""

    name: str
    count: int
    properties: tuple[Property, ...]

    @property
    def has_lists(self) -> bool:
        """Whether rows differ in length."""
        return any(prop.length_code for prop in self.properties)

    @property
    def least_bytes(self) -> int:
        """Bytes of one binary row, the least possible where it has lists."""
        return sum(prop.least_bytes for prop in self.properties)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns, in file order."""
        return tuple(prop.name for prop in self.properties)


@dataclass(frozen=True, slots=True)
class Header:
    """What a PLY file says about itself.

    Attributes
    ----------
    byte_order : str
        ``<``, ``>``, or empty for ASCII.
    elements : tuple of Element
        In file order.
    data_start : int
        Offset in bytes of the first row.
    comments : tuple of str
        Without the word ``comment``, in file order; what is not ASCII is escaped.
    remarks : tuple of bytes
        All lines of comments and ``obj_info``, as they are.
    """

    byte_order: str
    elements: tuple[Element, ...]
    data_start: int
    comments: tuple[str, ...] = ()
    remarks: tuple[bytes, ...] = ()

    def element(self, name: str) -> Element | None:
        """Return the element of that name, or None."""
        return next((element for element in self.elements if element.name == name), None)

    @property
    def least_bytes(self) -> int:
        """Bytes that the rows of all elements need at least."""
        if self.byte_order:
            return sum(element.count * element.least_bytes for element in self.elements)
        # A digit and a separator for every value; the last line may lack its newline.
        return max(0, sum(element.count * 2 * len(element.properties) for element in self.elements) - 1)


def read_header(file: BinaryIO, path: Path) -> Header:
    """Read the header at the start of ``file`` and leave the position unspecified.

    Raises
    ------
    CorruptFileError
        It breaks the rules of the format, or does not end within `MAX_HEADER` bytes.
    """
    file.seek(0)
    head = file.read(MAX_HEADER)
    if not head.startswith(MAGIC):
        raise CorruptFileError(path, f"begins with {head[:8]!r}, expected 'ply' on a line of its own", 0)
    byte_order: str | None = None
    elements: list[Element] = []
    comments: list[str] = []
    remarks: list[bytes] = []
    start = head.index(b"\n") + 1
    while (end := head.find(b"\n", start)) >= 0:

        def fault(problem: str, offset: int = start) -> CorruptFileError:
            return CorruptFileError(path, f"header: {problem}", offset)

        line = head[start:end]
        words = line.decode("ascii", "backslashreplace").split()
        start = end + 1
        match words:
            case ["end_header"]:
                if byte_order is None:
                    raise fault("no format line before end_header; expected e.g. 'format ascii 1.0'")
                return Header(byte_order, tuple(elements), start, tuple(comments), tuple(remarks))
            case ["format", kind, "1.0"] if kind in BYTE_ORDERS and byte_order is None:
                byte_order = BYTE_ORDERS[kind]
            case ["element", name, count]:
                elements.append(_element(name, count, elements, fault))
            case ["property", *rest] if elements:
                elements[-1] = _with_property(elements[-1], rest, fault)
            case ["comment" | "obj_info" as kind, *rest]:
                remarks.append(line.strip())
                if kind == "comment":
                    comments.append(" ".join(rest))
            case []:
                pass
            case _:
                raise fault(f"line {_shown(' '.join(words))} is not understood; write the file again")
    what = f"no end_header in the first {len(head)} bytes"
    raise CorruptFileError(path, f"header: {what}; the file is truncated or no PLY; fetch it again", len(head))


def _element(name: str, count: str, before: list[Element], fault: _Fault) -> Element:
    if not (count.isascii() and count.isdigit() and len(count) < 19):
        raise fault(f"element {_shown(name)} has count {_shown(count)}, expected a whole number from 0")
    if len(before) >= MAX_ELEMENTS:
        raise fault(f"more than {MAX_ELEMENTS} elements; remove what is not needed")
    if any(element.name == name for element in before):
        raise fault(f"element {_shown(name)} is declared twice; each name must be unique")
    return Element(name, int(count), ())


def _with_property(element: Element, words: list[str], fault: _Fault) -> Element:
    match words:
        case ["list", length, scalar, name] if SCALARS.get(length, "f")[0] != "f" and scalar in SCALARS:
            prop = Property(name, SCALARS[scalar], SCALARS[length])
        case [scalar, name] if scalar in SCALARS:
            prop = Property(name, SCALARS[scalar])
        case _:
            shown = _shown(" ".join(words))
            expected = f"a type ({', '.join(SCALARS)}) and a name"
            raise fault(f"property {shown} of {_shown(element.name)}, expected {expected}")
    if len(element.properties) >= MAX_COLUMNS:
        raise fault(f"{_shown(element.name)} has more than {MAX_COLUMNS} properties; remove what is not needed")
    if prop.name in element.names:
        raise fault(f"property {_shown(prop.name)} of {_shown(element.name)} is declared twice")
    return Element(element.name, element.count, (*element.properties, prop))


def _shown(text: str) -> str:
    # Names come from the file: quoted, with control characters escaped, and never longer than a line.
    return shown(text)
