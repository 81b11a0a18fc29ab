"""Arrays in a zip of .npy files, each checked before a byte of it is unpacked.

Source: the NPY format, ``numpy.lib.format``. Its own reader allocates what a header says.
"""

from __future__ import annotations

import math
import re
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from tsplat.io.sog_files import Archive

Floats = npt.NDArray[np.floating]

MAGIC = b"\x93NUMPY"

HEADER_BYTES = 1024
"""Longer headers describe records; an array of plain numbers takes 128."""

LENGTH_BYTES = {1: 2, 2: 4, 3: 4}
"""How long the length of the header is, by version."""


class Header(NamedTuple):
    """What an array is said to be.

    Attributes
    ----------
    dtype : dtype
        float16, float32 or float64, of either byte order, unless other kinds were asked for.
    shape : tuple of int
        Its sides.
    order : {"C", "F"}
        Whether the last index runs fastest, or the first.
    start : int
        Where in the file its numbers begin.
    """

    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    order: Literal["C", "F"]
    start: int


FLOATS, INTEGERS = "float16, float32 or float64", "whole numbers"
KINDS = {FLOATS: "f[248]", INTEGERS: "[iu][1248]"}
"""What numbers may be, and how their types are written."""


def read_header(archive: Archive, name: str, kind: str = FLOATS) -> Header:
    """Return what a .npy file says of its array; ``kind`` is one of `KINDS`.

    Raises
    ------
    CorruptFileError
        It is no such file, or its array is not of such numbers.
    """
    head = archive.read(name, HEADER_BYTES)
    if not head.startswith(MAGIC) or len(head) < 12 or head[6] not in LENGTH_BYTES:
        raise archive.corrupt(name, f"begins with {head[:8]!r}, expected {MAGIC!r} and a version from 1 to 3")
    begin = 8 + LENGTH_BYTES[head[6]]
    start = begin + int.from_bytes(head[8:begin], "little")
    if start > len(head):
        raise archive.corrupt(name, f"has a header up to byte {start}, expected up to {len(head)} at most")
    text = head[begin:start].decode("latin-1")
    descr = re.search(r"""['"]descr['"]\s*:\s*['"]?([^,'"}]{1,20})""", text)
    order = re.search(r"""['"]fortran_order['"]\s*:\s*(True|False)\b""", text)
    shape = re.search(r"""['"]shape['"]\s*:\s*\(([0-9, ]*)\)""", text)
    if descr is None or order is None or shape is None:
        raise archive.corrupt(name, f"has a header {text[:60]!a}, expected descr, fortran_order and shape")
    if not re.fullmatch(f"[<>=|]?{KINDS[kind]}", descr[1]):
        raise archive.corrupt(name, f"holds numbers of type {descr[1]!a}, expected {kind}")
    sides = tuple(int(side[:20]) for side in shape[1].replace(" ", "").split(",") if side)
    return Header(np.dtype(descr[1]), sides, "F" if order[1] == "True" else "C", start)


def read_array(archive: Archive, name: str, header: Header, *, wide: bool = False) -> Floats:
    """Return an array whose shape was found plausible, as float32; what is float64 stays so where it is ``wide``.

    Raises
    ------
    CorruptFileError
        It holds fewer or more bytes than its header says.
    """
    size = header.start + math.prod(header.shape) * header.dtype.itemsize
    content = archive.read(name, size + 1)
    if len(content) != size:
        held = "more" if len(content) > size else str(len(content))
        raise archive.corrupt(name, f"holds {held} bytes, expected {size} for its shape {list(header.shape)}")
    kind = np.float64 if wide and header.dtype.itemsize == 8 else np.float32
    numbers = np.frombuffer(content, header.dtype, offset=header.start)
    return numbers.reshape(header.shape, order=header.order).astype(kind, copy=False)
