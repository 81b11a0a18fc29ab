"""Where the vertices of a PLY are, before they are rounded to float32: far from the world's origin it matters."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from tsplat.io.ply_header import Element, Header
from tsplat.io.ply_rows import MAX_LINE
from tsplat.origin import SAMPLE, find_origin
from tsplat.scene import Vector

F64 = npt.NDArray[np.float64]

RUN = 64
"""Rows read together: as quick as one of them."""


def origin_of_rows(
    file: BinaryIO, header: Header, element: Element, start: int, columns: Sequence[int]
) -> Vector | None:
    """Return what is to be taken off the centres of an element, see `tsplat.origin.find_origin`.

    Parameters
    ----------
    file, header, element, start
        As for `tsplat.io.ply_rows.read_rows`.
    columns : sequence of 3 int
        The columns of x, y and z. Of float32 there is nothing to lose: where all are, they are not looked at.

    Notes
    -----
    Rows that are broken are passed over.
    """
    if not header.byte_order:
        return find_origin(_of_text(file, element, start, columns))
    if all(element.properties[column].code == "f4" for column in columns):
        return None
    return find_origin(_of_records(file, header, element, start, columns))


def _of_records(file: BinaryIO, header: Header, element: Element, start: int, columns: Sequence[int]) -> F64:
    record = np.dtype([(prop.name, header.byte_order + prop.code) for prop in element.properties])
    runs = []
    step = max(RUN, element.count * RUN // SAMPLE)
    for first in range(0, element.count, step):
        file.seek(start + first * record.itemsize)
        raw = file.read(min(RUN, element.count - first) * record.itemsize)
        rows = np.frombuffer(raw[: len(raw) - len(raw) % record.itemsize], record)
        with np.errstate(invalid="ignore"):  # any bits may be there, of numbers that signal when they are cast too
            runs.append(np.stack([rows[element.names[column]].astype(np.float64) for column in columns], axis=1))
    return np.concatenate(runs) if runs else np.empty((0, 3))


def _of_text(file: BinaryIO, element: Element, start: int, columns: Sequence[int]) -> F64:
    file.seek(start)
    rows = []
    step = 1 + element.count // SAMPLE
    for row in range(element.count):
        line = file.readline(MAX_LINE)
        if row % step:
            continue
        words = line.split()
        with contextlib.suppress(ValueError, IndexError):  # `read_rows` says what is wrong
            rows.append([float(words[column]) for column in columns])
    return np.array(rows).reshape(-1, 3)
