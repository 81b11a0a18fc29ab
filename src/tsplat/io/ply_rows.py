"""The rows of one element of a PLY file as float32, a chunk at a time, whatever their encoding.

Chunks are read, not mapped: every mapped page would count as memory of this process, and a chunk of this
size is decoded while it is still in the cache.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from tsplat.errors import CorruptFileError, shown
from tsplat.io.arrays import chunks
from tsplat.io.ply_header import Element, Header
from tsplat.io.ply_words import first_other, numbers

F32 = npt.NDArray[np.float32]
Shifts = Mapping[int, float]

CHUNK_BYTES = 1 << 19
"""What is decoded at once: with its output it fits a core's second-level cache."""

MAX_LINE = 1 << 20
"""Bytes read at once in search of a line's end."""


def read_rows(
    file: BinaryIO, path: Path, header: Header, element: Element, start: int, shifts: Shifts | None = None
) -> Iterator[F32]:
    """Yield the rows of ``element``, which has no lists, in file order.

    Parameters
    ----------
    file : binary file
        Open for reading.
    path : Path
        Its name, for errors.
    header : Header
        Of this file.
    element : Element
        One of the header's.
    start : int
        Offset in bytes of its first row, as `find_rows` returned it.
    shifts : mapping of int to float, optional
        What is subtracted from some columns, by their number, before they become float32.

    Yields
    ------
    ndarray of float32, [n, P]
        All P columns of n rows.

    Raises
    ------
    CorruptFileError
        The rows end early, or a line of an ASCII file is not a row.
    """
    file.seek(start)
    if header.byte_order:
        return _binary_rows(file, path, element, header.byte_order, shifts or {})
    return _text_rows(file, path, element, shifts or {})


def find_rows(file: BinaryIO, path: Path, header: Header, element: Element) -> int:
    """Return the offset in bytes of the first row of ``element``, walking over what comes before it.

    Raises
    ------
    CorruptFileError
        The elements of the file, this one or another, need more bytes than there are.
    """
    size = os.fstat(file.fileno()).st_size
    if size - header.data_start < header.least_bytes:
        counts = ", ".join(f"{each.count} {shown(each.name, 40)}" for each in header.elements)
        problem = f"rows: {counts} need at least {header.least_bytes} bytes, {size - header.data_start} are there"
        raise CorruptFileError(path, f"{problem}; the file is truncated, fetch it again", header.data_start)
    position = header.data_start
    for before in header.elements:
        if before is element:
            break
        if not header.byte_order:
            position = _skip_lines(file, path, before, position)
        elif before.has_lists:
            position = _skip_lists(file, path, before, position, size, header.byte_order)
        else:
            position += before.count * before.least_bytes
    if header.byte_order and size - position < element.count * element.least_bytes:
        raise _ended(path, element, (size - position) // element.least_bytes, size)
    return position


def _binary_rows(file: BinaryIO, path: Path, element: Element, byte_order: str, shifts: Shifts) -> Iterator[F32]:
    record = np.dtype([(prop.name, byte_order + prop.code) for prop in element.properties])
    all_float = all(prop.code == "f4" for prop in element.properties)
    for part in chunks(element.count, _chunk_rows(element)):
        n = part.stop - part.start
        buffer = np.empty(n, record)
        got = file.readinto(buffer.view(np.uint8).data)  # type: ignore[attr-defined]
        if got < buffer.nbytes:
            raise _ended(path, element, part.start + got // record.itemsize, file.tell())
        if all_float:
            yield buffer.view(byte_order + "f4").reshape(n, -1).astype(np.float32, copy=False)
        else:
            rows = np.empty((n, len(element.properties)), np.float32)
            with np.errstate(over="ignore", invalid="ignore"):  # a double may overflow to inf: dropped later
                for column, prop in enumerate(element.properties):
                    values = buffer[prop.name]
                    rows[:, column] = values - np.float64(shifts[column]) if column in shifts else values
            yield rows


def _text_rows(file: BinaryIO, path: Path, element: Element, shifts: Shifts) -> Iterator[F32]:
    size, columns = _chunk_rows(element), len(element.properties)
    for first in range(0, element.count, size):
        lines: list[list[bytes]] = []
        start = file.tell()
        for row in range(first, min(first + size, element.count)):
            line, words = _next_row(file)
            if len(words) != columns:
                if not line:
                    raise _ended(path, element, row, file.tell())
                problem = f"row {row} of {shown(element.name)} has {len(words)} values, expected {columns}"
                commas = b"," in line or b";" in line
                cure = "put spaces between them" if commas else "the file is damaged, fetch it again"
                raise CorruptFileError(path, f"{problem}; {cure}", file.tell())
            lines.append(words)
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                # One by one: an array of words would give each the room of the longest.
                values = np.array(numbers(lines))
                for column, shift in shifts.items():
                    values[:, column] -= shift
                rows = values.astype(np.float32)
        except ValueError as error:
            row, word = first_other(lines)
            seen = shown(word.decode("latin-1"), 24)
            problem = f"row {first + row} of {shown(element.name)} holds a word that is no number, {seen}"
            cure = "write decimals with a point" if b"," in word else "the file is damaged, fetch it again"
            raise CorruptFileError(path, f"{problem}; {cure}", start) from error
        yield rows


def _next_row(file: BinaryIO) -> tuple[bytes, list[bytes]]:
    """Return the next line that is not empty and no comment, and its words; nothing at the end of the file."""
    while True:
        line = file.readline(MAX_LINE)
        words = line.split()
        if not line or (words and words[0] != b"comment"):
            return line, words


def _skip_lines(file: BinaryIO, path: Path, element: Element, position: int) -> int:
    file.seek(position)
    for row in range(element.count if element.properties else 0):
        line, _ = _next_row(file)
        if not line:
            raise _ended(path, element, row, file.tell())
        while len(line) == MAX_LINE and not line.endswith(b"\n"):
            line = file.readline(MAX_LINE)
    return file.tell()


def _skip_lists(file: BinaryIO, path: Path, element: Element, position: int, size: int, byte_order: str) -> int:
    endian = "little" if byte_order == "<" else "big"
    steps = [
        (prop.least_bytes, np.dtype(prop.code).itemsize, prop.length_code or "") for prop in element.properties
    ]
    for row in range(element.count):
        for width, item, length_code in steps:
            if length_code:
                file.seek(position)
                length = int.from_bytes(file.read(width), endian, signed=length_code[0] == "i")  # type: ignore[arg-type]
                if length < 0:
                    problem = (
                        f"row {row} of {shown(element.name)} has a list of length {length}, expected 0 or more"
                    )
                    raise CorruptFileError(path, f"{problem}; the file is damaged, fetch it again", position)
                position += length * item
            position += width
            if position > size:
                raise _ended(path, element, row, size)
    return position


def _chunk_rows(element: Element) -> int:
    return max(1, CHUNK_BYTES // max(4 * len(element.properties), element.least_bytes, 1))


def _ended(path: Path, element: Element, row: int, offset: int) -> CorruptFileError:
    problem = f"ends in row {row} of {element.count} of {shown(element.name, 40)}"
    return CorruptFileError(path, f"{problem}; the file is truncated, fetch it again", offset)
