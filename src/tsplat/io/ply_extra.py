"""What a PLY holds that makes no splats: columns and elements of its own, and comments."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from tsplat.errors import CorruptFileError
from tsplat.extra import NORMALS, Extra, Table
from tsplat.io.arrays import chunks
from tsplat.io.ply_header import SCALARS, Element, Header, Property
from tsplat.io.ply_rows import MAX_LINE, find_rows

Array = npt.NDArray[Any]

INDICES = {"vertex_index", "vertex_indices", "vertex1", "vertex2", "vertex_id"}
"""Properties that name vertices by their numbers."""

FILTER = "filter_3D"
"""Ends the name of a column that becomes part of the splats, and must not be applied to them again."""

COLORS = {"red", "green", "blue"}
"""Part of the splats where these have no other colours."""

ROWS = 8192

NAMES = {code: name for name, code in reversed(SCALARS.items())}
"""The first name of each type."""


def read_extra(
    file: BinaryIO, path: Path, header: Header, used: Collection[str], elements: Collection[str]
) -> Extra | None:
    """Return what a PLY holds beside its splats, or None.

    Parameters
    ----------
    file, path, header
        The file, open for reading; its name, for errors; its header.
    used : collection of str
        The columns of the vertices that become splats. Normals that are all zero say nothing, and do not count.
    elements : collection of str
        The elements that become splats, ``vertex`` among them.

    Raises
    ------
    CorruptFileError
        The file ends early, or holds a list of no possible length.
    """
    vertex = header.element("vertex")
    assert vertex
    columns = _columns(file, path, header, vertex, used)
    tables = tuple(
        _table(file, path, header, element) for element in header.elements if element.name not in elements
    )
    if not (columns.dtype.names or tables or header.remarks):
        return None
    return Extra(columns, header.remarks, tables)


def table_lines(table: Table) -> list[str]:
    """Return the lines of a header that declare an element."""
    return [f"element {table.name} {table.count}", *(f"property {line}" for line in table.properties)]


def column_lines(columns: Array) -> list[str]:
    """Return the lines of a header that declare columns."""
    return [f"property {NAMES[columns.dtype[name].str[1:]]} {name}" for name in columns.dtype.names or ()]


def _columns(file: BinaryIO, path: Path, header: Header, vertex: Element, used: Collection[str]) -> Array:
    ours = {*used} if "f_dc_0" in vertex.names else {*used, *COLORS}
    own = [prop for prop in vertex.properties if prop.name not in ours and not prop.name.endswith(FILTER)]
    columns = np.empty(vertex.count, [(prop.name, "<" + prop.code) for prop in own])
    if not own:
        return columns
    done = 0
    file.seek(find_rows(file, path, header, vertex))
    for rows in _rows(file, path, header, vertex):
        for prop in own:
            columns[prop.name][done : done + len(rows)] = rows[prop.name]
        done += len(rows)
    if set(NORMALS) <= set(columns.dtype.names or ()) and not any(columns[name].any() for name in NORMALS):
        return _without(columns, NORMALS)
    return columns


def _without(columns: Array, names: Collection[str]) -> Array:
    left = [name for name in columns.dtype.names or () if name not in names]
    copy = np.empty(len(columns), [(name, columns.dtype[name]) for name in left])
    for name in left:
        copy[name] = columns[name]
    return copy


def _rows(file: BinaryIO, path: Path, header: Header, element: Element) -> Iterator[Array]:
    """Yield the rows of an element without lists, from where the file stands, as structured arrays."""
    record = np.dtype([(prop.name, (header.byte_order or "<") + prop.code) for prop in element.properties])
    for part in chunks(element.count, ROWS):
        count = part.stop - part.start
        if header.byte_order:
            rows = np.fromfile(file, record, count)
        else:
            words = [file.readline(MAX_LINE).split() for _ in range(count)]
            whole = [tuple(map(_number, line)) for line in words if len(line) == len(element.properties)]
            with np.errstate(invalid="ignore", over="ignore"):
                rows = np.array(whole, [(name, "f8") for name in element.names]).astype(record)
        if len(rows) < count:
            raise _ended(path, element, part.start + len(rows), file)
        yield rows


def _number(word: bytes) -> float:
    try:
        return float(word)
    except ValueError:
        return np.nan  # what other programs write for it


def _table(file: BinaryIO, path: Path, header: Header, element: Element) -> Table:
    file.seek(find_rows(file, path, header, element))
    if element.has_lists:
        rows = b"".join(_rows_with_lists(file, path, header, element))
    else:
        little = np.dtype([(prop.name, "<" + prop.code) for prop in element.properties])
        rows = b"".join(part.astype(little).tobytes() for part in _rows(file, path, header, element))
    vertex = header.element("vertex")
    one_each = vertex is not None and element.count == vertex.count > 1
    about_splats = one_each or bool(INDICES & set(element.names))
    return Table(element.name, element.count, tuple(map(_declared, element.properties)), rows, about_splats)


def _declared(prop: Property) -> str:
    length = f"list {NAMES[prop.length_code]} " if prop.length_code else ""
    return f"{length}{NAMES[prop.code]} {prop.name}"


def _rows_with_lists(file: BinaryIO, path: Path, header: Header, element: Element) -> Iterator[bytes]:
    size = os.fstat(file.fileno()).st_size
    words: Iterator[bytes] = iter(())

    def take(count: int, code: str, row: int) -> Array:
        kind = np.dtype((header.byte_order or "<") + code)
        if not 0 <= count * (kind.itemsize if header.byte_order else 2) <= size - file.tell() + MAX_LINE:
            raise _ended(path, element, row, file)
        if header.byte_order:
            raw = file.read(count * kind.itemsize)
            values = np.frombuffer(raw[: len(raw) // kind.itemsize * kind.itemsize], kind)
        else:
            numbers = np.array([_number(word) for _, word in zip(range(count), words, strict=False)])
            with np.errstate(invalid="ignore", over="ignore"):
                values = numbers.astype(kind)
        if len(values) < count:
            raise _ended(path, element, row, file)
        return values.astype("<" + code)

    for row in range(element.count):
        if not header.byte_order:
            words = iter(file.readline(MAX_LINE).split())
        for prop in element.properties:
            count = 1
            if prop.length_code:
                length = take(1, prop.length_code, row)
                count = int(length[0])
                yield length.tobytes()
            yield take(count, prop.code, row).tobytes()


def _ended(path: Path, element: Element, row: int, file: BinaryIO) -> CorruptFileError:
    problem = f"ends in row {row} of {element.count} of {ascii(element.name)[:40]}"
    return CorruptFileError(path, f"{problem}; the file is truncated, fetch it again", file.tell())
