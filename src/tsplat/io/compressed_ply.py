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
from tsplat.io.ply_columns import REST_COUNTS, rest_names
from tsplat.io.ply_header import Element, Header
from tsplat.io.ply_rows import find_rows

F32 = npt.NDArray[np.float32]
U32 = npt.NDArray[np.uint32]
Arrays = tuple[F32, F32, F32, F32, F32]

CHUNK = 256
"""Splats that share bounds; the last chunk of a file may hold fewer."""

BLOCK = 32 * CHUNK
"""Rows decoded at once."""

SH_C0 = 0.28209479177387814
SH_RANGE = 4.0
"""Higher coefficients are kept from minus to plus this."""

WORDS = ("packed_position", "packed_rotation", "packed_scale", "packed_color")

SH_LEVELS = ((np.arange(256) + 0.5) / 128.0 - 1.0) * SH_RANGE
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
    tuple of ndarray of float32
        ``means``, ``quats``, ``scales``, ``opacities`` and ``sh`` as `tsplat.io.finish.finish` takes them; bounds
        that are nan or inf make the same of their splats.

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
    means, quats, scales = (np.empty((n, width), np.float32) for width in (3, 4, 3))
    opacities, sh = np.empty(n, np.float32), np.empty((n, k, 3), np.float32)
    half = 0.5 if rest else 1.0
    for first, rows in _blocks(file, path, header, vertex):
        part = slice(first, first + len(rows))
        low, high = (np.repeat(ends[first // CHUNK :][: BLOCK // CHUNK], CHUNK, 0)[: len(rows)] for ends in bounds)
        found = _splats(rows, low, high)
        means[part], quats[part], scales[part], opacities[part], sh[part, 0] = found
        progress(half * part.stop / n)
    if rest:
        for first, rows in _blocks(file, path, header, rest):
            steps = np.stack([rows[name] for name in rest_names(k)], axis=1)
            sh[first : first + len(rows), 1:] = SH_LEVELS[steps].reshape(len(rows), k - 1, 3)
            progress(half + half * (first + len(rows)) / n)
    return means, quats, scales, opacities, sh


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
    # Minima and maxima, each [chunks, 3 fields, 3 axes]; without bounds colours go from 0 to 1.
    names = POSITION_BOUNDS + SCALE_BOUNDS + COLOR_BOUNDS
    blocks = [
        np.stack(
            [rows[name] if name in chunk.names else np.full(len(rows), name[:3] == "max") for name in names], 1
        )
        for _, rows in _blocks(file, path, header, chunk)
    ]
    bounds = np.concatenate([np.empty((0, len(names))), *blocks]).astype(np.float32).reshape(-1, 3, 2, 3)
    return bounds[:, :, 0], bounds[:, :, 1]


def _blocks(
    file: BinaryIO, path: Path, header: Header, element: Element
) -> Iterator[tuple[int, npt.NDArray[np.void]]]:
    record: np.dtype[Any] = np.dtype([(prop.name, header.byte_order + prop.code) for prop in element.properties])
    file.seek(find_rows(file, path, header, element))
    for first in range(0, element.count, BLOCK):
        rows = np.empty(min(BLOCK, element.count - first), record)
        got = file.readinto(rows.view(np.uint8).data)  # type: ignore[attr-defined]
        if got < rows.nbytes:
            problem = f"ends in row {first + got // record.itemsize} of {element.count} of {element.name!r}"
            raise CorruptFileError(path, f"{problem}; the file is truncated, fetch it again", file.tell())
        yield first, rows


def _splats(rows: npt.NDArray[np.void], low: F32, high: F32) -> Arrays:
    position, rotation, scale, color = (rows[word].astype(np.uint32) for word in WORDS)
    levels = _fields(color, (24, 16, 8, 0), (8, 8, 8, 8))
    means = _between(low[:, 0], high[:, 0], _three(position))
    scales = np.exp(_between(low[:, 1], high[:, 1], _three(scale)))
    colors = _between(low[:, 2], high[:, 2], levels[:, :3])
    return means, _quats(rotation), scales, levels[:, 3], (colors - 0.5) / np.float32(SH_C0)


def _fields(words: U32, shifts: tuple[int, ...], bits: tuple[int, ...]) -> F32:
    # Bit fields of each word, from 0 to 1; [N, fields].
    tops = (1 << np.array(bits, np.uint32)) - 1
    fields: F32 = ((words[:, None] >> np.array(shifts, np.uint32)) & tops).astype(np.float32)
    fields /= tops.astype(np.float32)
    return fields


def _three(words: U32) -> F32:
    return _fields(words, (21, 11, 0), (11, 10, 11))


def _between(low: F32, high: F32, part: F32) -> F32:
    # Written so that 0 and 1 give the bounds to the bit.
    between: F32 = low * (1.0 - part) + high * part
    return between


def _quats(words: U32) -> F32:
    # The largest component is left out: it follows from the others, and its sign was made positive.
    others = (_fields(words, (20, 10, 0), (10, 10, 10)) - 0.5) * np.float32(math.sqrt(2.0))
    largest = np.sqrt(np.maximum(0.0, 1.0 - np.einsum("ij,ij->i", others, others)))
    which = (words >> 30)[:, None]
    quats = np.empty((len(words), 4), np.float32)
    np.put_along_axis(quats, which.astype(np.intp), largest[:, None], 1)
    places = np.arange(3) + (np.arange(3) >= which)
    np.put_along_axis(quats, places, others, 1)
    return quats
