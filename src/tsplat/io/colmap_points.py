"""COLMAP's sparse points, points3D.bin and points3D.txt: what training begins with, where they were seen left out.

Source: COLMAP's documentation, *Output Format*.
"""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from tsplat.errors import CorruptFileError
from tsplat.io.arrays import Arrays, chunks
from tsplat.io.finish import finish
from tsplat.io.options import LoadOptions
from tsplat.io.ply_words import first_other, numbers
from tsplat.io.points import make_balls
from tsplat.scene import SH_C0, Gaussians

F64 = npt.NDArray[np.float64]

TITLE = b"# 3D point list"
"""How COLMAP begins the text."""

COUNT = struct.Struct("<Q")
POINT = np.dtype([("id", "<u8"), ("xyz", "<f8", 3), ("rgb", "u1", 3), ("error", "<f8"), ("seen", "<u8")])
SEEN_BYTES = 8
"""An image and a feature in it, for each time that a point was seen."""

FIELDS = 7
"""Words of a line that are looked at: a number, a place and a colour."""

LINES, MAX_LINE = 4096, 1 << 16

_SAID = re.compile(rb"# Number of points: (\d{1,18})\b")


def matches_text(head: bytes) -> bool:
    """Tell whether a file that begins with these bytes is a points3D.txt."""
    return head.startswith(TITLE)


def matches_binary(head: bytes) -> bool:  # noqa: ARG001
    """Say that the first bytes tell nothing: the name has to."""
    return False


def read_binary(path: Path, options: LoadOptions, progress: Callable[[float], None]) -> Gaussians:
    """Read a points3D.bin; see `tsplat.io.load` for the parameters.

    Raises
    ------
    CorruptFileError
        It is not as long as it says.

    Warns
    -----
    LoadWarning
        Always: these are no splats.
    """
    arrays = _binary_points(path, progress)
    good = make_balls(path, arrays, "a point cloud of COLMAP")
    return finish(path, *arrays, good=good, max_splats=options.max_splats)


def read_text(path: Path, options: LoadOptions, progress: Callable[[float], None]) -> Gaussians:
    """Read a points3D.txt; see `tsplat.io.load` for the parameters.

    Raises
    ------
    CorruptFileError
        A line is no point, or there are fewer than it says.

    Warns
    -----
    LoadWarning
        Always: these are no splats.
    """
    arrays = _text_points(path, progress)
    good = make_balls(path, arrays, "a point cloud of COLMAP")
    return finish(path, *arrays, good=good, max_splats=options.max_splats)


def _binary_points(path: Path, progress: Callable[[float], None]) -> Arrays:
    with path.open("rb") as file:
        content = file.read()
    starts = _starts(path, content, progress)
    raw, arrays = np.frombuffer(content, np.uint8), Arrays.empty(len(starts), 1)
    for rows in chunks(len(starts)):
        points = raw[starts[rows, None] + np.arange(POINT.itemsize)].view(POINT)[:, 0]
        _fill(arrays.part(rows), points["xyz"], points["rgb"])
        progress(0.5 + 0.5 * rows.stop / len(starts))
    return arrays


def _text_points(path: Path, progress: Callable[[float], None]) -> Arrays:
    with path.open("rb") as file:
        points = np.concatenate([np.empty((0, FIELDS)), *_text_rows(file, path, progress)])
    arrays = Arrays.empty(len(points), 1)
    _fill(arrays, points[:, 1:4], points[:, 4:7])
    return arrays


def _fill(out: Arrays, xyz: F64, rgb: npt.NDArray[np.generic]) -> None:
    with np.errstate(over="ignore", invalid="ignore"):  # what that makes is left out
        out.means[:] = xyz
        out.sh[:, 0] = (rgb.astype(np.float64) / 255.0 - 0.5) / SH_C0


def _starts(path: Path, content: bytes, progress: Callable[[float], None]) -> npt.NDArray[np.int64]:
    """Return where each point starts."""
    size, position = len(content), COUNT.size
    if size < position:
        raise CorruptFileError(path, f"holds {size} bytes, expected a count of {position}; fetch it again", 0)
    (count,) = COUNT.unpack_from(content)
    if count > (size - position) // POINT.itemsize:
        problem = f"says {count} points, which need {POINT.itemsize} bytes each, but holds {size}"
        raise CorruptFileError(path, f"{problem}; it is truncated or something else, fetch it again", 0)
    starts = np.empty(count, np.int64)
    unpack, to_seen = COUNT.unpack_from, POINT.itemsize - COUNT.size
    for rows in chunks(count):
        for number in range(rows.start, rows.stop):
            if position + POINT.itemsize > size:
                raise _ended(path, number, count, size)
            starts[number] = position
            (seen,) = unpack(content, position + to_seen)
            position += POINT.itemsize + SEEN_BYTES * seen
        progress(0.5 * rows.stop / count)
    if position > size:
        raise _ended(path, count - 1, count, size)
    if position < size:
        problem = f"goes on for {size - position} bytes behind its {count} points"
        raise CorruptFileError(path, f"{problem}; it is something else, or damaged, fetch it again", position)
    return starts


def _ended(path: Path, number: int, count: int, offset: int) -> CorruptFileError:
    return CorruptFileError(path, f"ends in point {number} of {count}; it is truncated, fetch it again", offset)


def _text_rows(file: BinaryIO, path: Path, progress: Callable[[float], None]) -> Iterator[F64]:
    """Yield the first `FIELDS` numbers of some lines at a time."""
    size, said, found = os.fstat(file.fileno()).st_size, 0, 0
    rows: list[list[bytes]] = []
    start = 0
    while line := file.readline(MAX_LINE):
        if whole := _SAID.match(line):
            said = int(whole[1])
        words = line.split(maxsplit=FIELDS)[:FIELDS]
        while len(line) == MAX_LINE and not line.endswith(b"\n"):  # seen very often
            line = file.readline(MAX_LINE)
        if not words or words[0].startswith(b"#"):
            continue
        if len(words) < FIELDS:
            problem = f"point {found + len(rows)} has {len(words)} values, expected {FIELDS} or more"
            raise CorruptFileError(
                path, f"{problem}: a number, x, y, z, red, green, blue; fetch it again", file.tell()
            )
        rows.append(words)
        if len(rows) == LINES:
            yield _numbers(path, rows, found, start)
            found, rows, start = found + len(rows), [], file.tell()
            progress(min(1.0, start / max(size, 1)))
    if rows:
        yield _numbers(path, rows, found, start)
    if (found := found + len(rows)) < said:
        raise _ended(path, found, said, file.tell())


def _numbers(path: Path, rows: list[list[bytes]], first: int, start: int) -> F64:
    try:
        return np.array(numbers(rows))
    except ValueError as error:
        row, word = first_other(rows)
        shown = ascii(word[:24].decode("latin-1"))
        problem = f"point {first + row} holds a word that is no number, {shown}; fetch it again"
        raise CorruptFileError(path, problem, start) from error
