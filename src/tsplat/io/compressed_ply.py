"""PLY as PlayCanvas compresses it: 16 bytes a splat, within the bounds of its chunk of 256.

Source: the compressed PLY reader and writer of PlayCanvas' *splat-transform*. A file holds an element ``chunk``
(bounds of means, log scales and, in newer files, colours), an element ``vertex`` (four words a splat: position
and scale as 11, 10 and 11 bits, rotation as the smallest three with 10 bits each, colour and opacity as bytes)
and maybe an element ``sh`` (a byte for each higher coefficient, channel-major).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from tsplat.errors import CorruptFileError, LoadError
from tsplat.io.arrays import F32, Arrays, chunks
from tsplat.io.ply_columns import REST_COUNTS, rest_names
from tsplat.io.ply_header import Element, Header
from tsplat.io.ply_rows import find_rows
from tsplat.io.smallest_three import BY_COMPONENT, fill_quats
from tsplat.io.threads import on_threads
from tsplat.scene import SH_C0

U32 = npt.NDArray[np.uint32]
Records = npt.NDArray[np.void]

CHUNK = 256
"""Splats that share bounds; the last chunk of a file may hold fewer."""

BLOCK = 16 * CHUNK
"""Rows decoded at once; as many as `tsplat.io.arrays.CHUNK`, but whole chunks in any case."""

SH_RANGE = 4.0
"""Higher coefficients are kept from minus to plus this."""

WORDS = ("packed_position", "packed_rotation", "packed_scale", "packed_color")

SH_LEVELS = (((np.arange(256) + 0.5) / 128.0 - 1.0) * SH_RANGE).astype(np.float32)
SH_LEVELS[[0, 255]] = -SH_RANGE, SH_RANGE  # the outer steps stand for the ends of the range, not their middle


def bound_names(prefix: str, axes: str) -> list[str]:
    """Return the columns of a chunk's bounds: three minima, then three maxima."""
    return [f"{end}_{prefix}{axis}" for end in ("min", "max") for axis in axes]


POSITION_BOUNDS, SCALE_BOUNDS, COLOR_BOUNDS = (
    bound_names("", "xyz"),
    bound_names("scale_", "xyz"),
    bound_names("", "rgb"),
)


def is_compressed(header: Header) -> bool:
    """Tell whether the PLY of this header holds compressed splats."""
    vertex = header.element("vertex")
    packed = vertex is not None and any(name in WORDS for name in vertex.names)
    return packed and header.element("chunk") is not None


def read_arrays(file: BinaryIO, path: Path, header: Header, progress: Callable[[float], None]) -> Arrays:
    """Decode every splat.

    Parameters
    ----------
    file : binary file
        Open for reading.
    path : Path
        Its name, for errors.
    header : Header
        Of this file; `is_compressed` said yes.
    progress : callable
        Called with the fraction done.

    Returns
    -------
    Arrays
        As `tsplat.io.finish.finish` takes them; bounds that are nan or inf make the same of their splats.

    Raises
    ------
    LoadError
        It is an ASCII file.
    CorruptFileError
        Elements are missing or contradict each other, or the file ends early.
    """
    chunk, vertex, rest = _elements(path, header)
    bounds = _read_bounds(file, path, header, chunk)
    n, k = vertex.count, 1 + (len(rest.properties) // 3 if rest else 0)
    arrays = Arrays.empty(n, k)
    elements = [vertex, rest] if rest else [vertex]
    # Records of the rest hold nothing but these bytes.
    rest_columns = [rest.names.index(name) for name in rest_names(k)] if rest else []

    def pieces() -> Iterator[tuple[Element, slice, Records]]:
        for number, element in enumerate(elements):
            for rows, records in _blocks(file, path, header, element):
                yield element, rows, records
                progress((number + rows.stop / n) / len(elements))

    def decode(piece: tuple[Element, slice, Records]) -> None:
        element, rows, records = piece
        out = arrays.part(rows)
        if element is vertex:
            low, high = (np.repeat(_of_chunks(ends, rows), CHUNK, 1)[:, : len(records)] for ends in bounds)
            _decode_splats(records, low, high, out)
        else:
            steps = records.view(np.uint8).reshape(len(records), -1)[:, rest_columns]
            out.sh[:, 1:] = np.take(SH_LEVELS, steps, mode="clip").reshape(len(records), k - 1, 3)

    on_threads(decode, pieces())
    return arrays


def _elements(path: Path, header: Header) -> tuple[Element, Element, Element | None]:
    if not header.byte_order:
        raise LoadError(path, "is a compressed PLY in ASCII, expected binary; export the scene again")
    chunk, vertex, rest = (header.element(name) for name in ("chunk", "vertex", "sh"))
    assert chunk is not None  # `is_compressed` saw both
    assert vertex is not None
    colored = any(name in COLOR_BOUNDS for name in chunk.names)
    _require(path, chunk, POSITION_BOUNDS + SCALE_BOUNDS + (COLOR_BOUNDS if colored else []), "f4", "float")
    _require(path, vertex, list(WORDS), "u4", "uint")
    _require_count(path, chunk, math.ceil(vertex.count / CHUNK), f"{vertex.count} splats in chunks of {CHUNK}")
    if rest:
        found = len(rest.properties)
        if found not in REST_COUNTS[1:]:
            expected = ", ".join(map(str, REST_COUNTS[1:]))
            problem = f"sh: {found} properties, expected {expected} (SH degree 1 to 4)"
            raise CorruptFileError(path, f"{problem}; export the scene again")
        _require(path, rest, rest_names(found // 3 + 1), "u1", "uchar")
        _require_count(path, rest, vertex.count, f"{vertex.count} splats")
    return chunk, vertex, rest


def _require(path: Path, element: Element, names: list[str], code: str, shown: str) -> None:
    codes = {prop.name: prop.code for prop in element.properties if not prop.length_code}
    if wrong := [name for name in names if codes.get(name) != code]:
        problem = f"{element.name}: properties missing or not {shown}: {', '.join(wrong[:4])}"
        raise CorruptFileError(path, f"{problem}; export the scene again")
    if element.has_lists:
        raise CorruptFileError(path, f"{element.name}: has a list, expected only numbers; export the scene again")


def _require_count(path: Path, element: Element, expected: int, why: str) -> None:
    if element.count != expected:
        problem = f"{element.name}: {element.count} rows, expected {expected} for {why}"
        raise CorruptFileError(path, f"{problem}; fetch it again")


def _read_bounds(file: BinaryIO, path: Path, header: Header, chunk: Element) -> tuple[F32, F32]:
    # Minima and maxima, each [9, chunks]: of means, log scales and colours; without bounds colours go from 0 to 1.
    names = POSITION_BOUNDS + SCALE_BOUNDS + COLOR_BOUNDS
    blocks = [
        np.stack(
            [rows[name] if name in chunk.names else np.full(len(rows), name[:3] == "max") for name in names], 1
        )
        for _, rows in _blocks(file, path, header, chunk)
    ]
    bounds = np.concatenate([np.empty((0, len(names))), *blocks]).astype(np.float32).T.reshape(3, 2, 3, -1)
    return bounds[:, 0].reshape(9, -1), bounds[:, 1].reshape(9, -1)


def _blocks(file: BinaryIO, path: Path, header: Header, element: Element) -> Iterator[tuple[slice, Records]]:
    record: np.dtype[Any] = np.dtype([(prop.name, header.byte_order + prop.code) for prop in element.properties])
    file.seek(find_rows(file, path, header, element))
    for part in chunks(element.count, BLOCK):
        rows = np.empty(part.stop - part.start, record)
        got = file.readinto(rows.view(np.uint8).data)  # type: ignore[attr-defined]
        if got < rows.nbytes:
            problem = f"ends in row {part.start + got // record.itemsize} of {element.count} of {element.name!r}"
            raise CorruptFileError(path, f"{problem}; the file is truncated, fetch it again", file.tell())
        yield part, rows


def _of_chunks(ends: F32, rows: slice) -> F32:
    return ends[:, rows.start // CHUNK : -(-rows.stop // CHUNK)]


def _decode_splats(records: Records, low: F32, high: F32, out: Arrays) -> None:
    # Fields lie in rows, [fields, N], until the end: they are longer than the three of a splat.
    position, rotation, scale, color = (records[word].astype(np.uint32) for word in WORDS)
    out.means[:] = _between(low[:3], high[:3], _three(position)).T
    out.scales[:] = np.exp(_between(low[3:6], high[3:6], _three(scale))).T
    levels = _fields(color, (24, 16, 8, 0), (8, 8, 8, 8))
    out.sh[:, 0] = ((_between(low[6:], high[6:], levels[:3]) - np.float32(0.5)) / np.float32(SH_C0)).T
    out.opacities[:] = levels[3]
    # The largest component is left out: it follows from the others, and its sign was made positive.
    others = (_fields(rotation, (20, 10, 0), (10, 10, 10)) - np.float32(0.5)) * np.float32(math.sqrt(2.0))
    fill_quats(others.T, rotation >> 30, BY_COMPONENT, out.quats)


def _fields(words: U32, shifts: tuple[int, ...], bits: tuple[int, ...]) -> F32:
    # Bit fields of each word, from 0 to 1; [fields, N].
    tops = (1 << np.array(bits, np.uint32)[:, None]) - 1
    fields: F32 = (words >> np.array(shifts, np.uint32)[:, None] & tops).astype(np.float32)
    fields /= tops.astype(np.float32)
    return fields


def _three(words: U32) -> F32:
    return _fields(words, (21, 11, 0), (11, 10, 11))


def _between(low: F32, high: F32, part: F32) -> F32:
    # Written so that 0 and 1 give the bounds to the bit.
    between: F32 = low * (1.0 - part) + high * part
    return between
