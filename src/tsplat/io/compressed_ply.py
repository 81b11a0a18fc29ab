"""PLY as PlayCanvas compresses it: 16 bytes a splat, within the bounds of its chunk of 256.

Source: the compressed PLY reader and writer of PlayCanvas' *splat-transform*. A file holds an element ``chunk``
(bounds of means, log scales and, in newer files, colours), an element ``vertex`` (four words a splat: position
and scale as 11, 10 and 11 bits, rotation as the smallest three with 10 bits each, colour and opacity as bytes)
and maybe an element ``sh`` (a byte for each higher coefficient, channel-major).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import repeat
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from tsplat.decode import Decoders, decoders
from tsplat.errors import CorruptFileError, LoadError
from tsplat.io.arrays import F32, Arrays, chunks
from tsplat.io.finish import Mask, mark_finite
from tsplat.io.ply_columns import REST_COUNTS, rest_names
from tsplat.io.ply_header import Element, Header
from tsplat.io.ply_rows import find_rows
from tsplat.io.threads import on_threads
from tsplat.scene import SH_C0

U32 = npt.NDArray[np.uint32]
Records = npt.NDArray[np.void]

CHUNK = 256
"""Splats that share bounds; the last chunk of a file may hold fewer."""

BLOCK = 32 * CHUNK
"""Rows decoded at once: more of them pay on a busy machine, where threads wait for each other at every one."""

SH_RANGE = 4.0
"""Higher coefficients are kept from minus to plus this."""

WORDS = ("packed_position", "packed_rotation", "packed_scale", "packed_color")

_INNER_LEVELS = (np.arange(1, 255) + 0.5) / 128.0 - 1.0
SH_LEVELS = (np.array([-1.0, *_INNER_LEVELS, 1.0]) * SH_RANGE).astype(np.float32)
"""What bytes stand for; the outer ones for the ends of the range, not the middle of a step."""

THREE = np.array([[21, 11, 0], [2047, 1023, 2047]], np.uint32)
COLORS = np.array([[24, 16, 8], [255, 255, 255]], np.uint32)
"""Where the fields of a word begin, and their highest values."""

FLAT = -1000.0
"""A log scale in place of minus infinity, between which and another nothing lies: its exp is 0 as well."""

OPACITY = np.uint32(255)
"""The last byte of a colour."""

QUAT_LEVELS = ((np.arange(1024) / 1023 - 0.5) * math.sqrt(2.0)).astype(np.float32)
QUAT_PLACES = np.array([[0, 1, 2, 3], [1, 0, 2, 3], [2, 0, 1, 3], [3, 0, 1, 2]], np.uint8)
"""The largest is numbered as in ``wxyz`` and left out, its sign made positive; the others follow in that order."""


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


def read_arrays(
    file: BinaryIO, path: Path, header: Header, progress: Callable[[float], None]
) -> tuple[Arrays, Mask]:
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
    arrays : Arrays
        As `tsplat.io.finish.finish` takes them; bounds that are nan or inf make the same of their splats.
    good : ndarray of bool, [N]
        Which splats are not so; all quats are unit quats.

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
    # What lies between finite bounds is finite, except for the exp of a log scale.
    finite = np.all([np.isfinite(ends).all(axis=1) for ends in (*bounds[:2], *bounds[4:])], axis=0)
    good = np.repeat(finite, CHUNK)[:n]
    # Records of the rest hold nothing but these bytes.
    rest_columns = np.array([rest.names.index(name) for name in rest_names(k)] if rest else [], np.uint8)
    decode_with = decoders()

    def pieces() -> Iterator[tuple[slice, Records, Records | None]]:
        # Side by side, so that what a splat becomes is written while it is in the cache.
        steps = _blocks(file, path, header, rest) if rest else repeat((None, None))
        for (rows, words), (_, rest_steps) in zip(_blocks(file, path, header, vertex), steps, strict=False):
            yield rows, words, rest_steps
            progress(rows.stop / n)

    def decode(piece: tuple[slice, Records, Records | None]) -> None:
        rows, words, rest_steps = piece
        out = arrays.part(rows)
        if rest_steps is not None:
            steps = rest_steps.view(np.uint8).reshape(len(words), -1)
            decode_with.look_up(steps, rest_columns, SH_LEVELS, 3, out.sh.reshape(len(words), -1))
        _decode_splats(words, [_of_chunks(ends, rows) for ends in bounds], decode_with, out)
        mark_finite(out.scales, good[rows])

    on_threads(decode, pieces())
    return arrays, good


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


def _read_bounds(file: BinaryIO, path: Path, header: Header, chunk: Element) -> list[F32]:
    # Low and high ones of means, log scales and first coefficients, each [chunks, 3]; colours without any go from
    # 0 to 1.
    names = POSITION_BOUNDS + SCALE_BOUNDS + COLOR_BOUNDS
    blocks = [
        np.stack(
            [rows[name] if name in chunk.names else np.full(len(rows), name[:3] == "max") for name in names], 1
        )
        for _, rows in _blocks(file, path, header, chunk)
    ]
    with np.errstate(over="ignore", invalid="ignore"):  # of numbers that their splats are left out for
        bounds = np.concatenate([np.empty((0, len(names))), *blocks]).astype(np.float64)
        bounds[:, 12:] = (bounds[:, 12:] - 0.5) / SH_C0
        bounds[:, 6:12][np.isneginf(bounds[:, 6:12])] = FLAT
        return [np.ascontiguousarray(three, np.float32) for three in np.split(bounds, 6, axis=1)]


def _blocks(file: BinaryIO, path: Path, header: Header, element: Element) -> Iterator[tuple[slice, Records]]:
    record: np.dtype[Any] = np.dtype([(prop.name, header.byte_order + prop.code) for prop in element.properties])
    start = find_rows(file, path, header, element)
    for part in chunks(element.count, BLOCK):
        file.seek(start + part.start * record.itemsize)  # the rows of another element may have been read
        rows = np.empty(part.stop - part.start, record)
        got = file.readinto(rows.view(np.uint8).data)  # type: ignore[attr-defined]
        if got < rows.nbytes:
            problem = f"ends in row {part.start + got // record.itemsize} of {element.count} of {element.name!r}"
            raise CorruptFileError(path, f"{problem}; the file is truncated, fetch it again", file.tell())
        yield part, rows


def _of_chunks(ends: F32, rows: slice) -> F32:
    return ends[rows.start // CHUNK : -(-rows.stop // CHUNK)]


def _decode_splats(records: Records, bounds: list[F32], decode_with: Decoders, out: Arrays) -> None:
    position, rotation, scale, color = (records[word].astype(np.uint32) for word in WORDS)
    between = decode_with.between
    between(position, *THREE, *bounds[:2], CHUNK, out.means)
    between(scale, *THREE, *bounds[2:4], CHUNK, out.scales)
    np.exp(out.scales, out=out.scales)
    between(color, *COLORS, *bounds[4:], CHUNK, out.sh.reshape(len(color), -1))
    np.divide((color & OPACITY).astype(np.float32), np.float32(OPACITY), out=out.opacities)
    decode_with.smallest_three(rotation, QUAT_LEVELS, QUAT_PLACES, out.quats)
