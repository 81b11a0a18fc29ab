"""Halves that a writer without such a type kept in columns of 16-bit integers.

Only values tell them from whole numbers: a log scale, a logit or a colour's coefficient of thousands means
nothing, and that is what the bits of a half look like.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

import numpy as np

from tsplat.errors import LoadWarning
from tsplat.io.ply_columns import NAMES, Columns
from tsplat.io.ply_header import Element, Header

TELLING = 100.0
"""The exp of a log scale beyond 88 is inf in float32; halves from 1e-5 on are at least 168 as whole numbers."""

SAMPLE = 4096
"""Rows that are looked at."""

CODES = ("u2", "i2")


def with_halves(
    file: BinaryIO, path: Path, header: Header, vertex: Element, columns: Columns, start: int
) -> Element:
    """Return the vertices with the types that are meant, and warn where they are not those of the header.

    Parameters
    ----------
    file : binary file
        Open for reading.
    path : Path
        Its name, for the warning.
    header, vertex, columns : Header, Element, Columns
        Of this file.
    start : int
        Offset in bytes of the first row of ``vertex``.
    """
    codes = [prop.code for prop in vertex.properties]
    others = set(columns.arrays["sh"].tolist()) if columns.colors != "harmonics" else set[int]()
    short = {column for column in columns.used - others if codes[column] in CODES}
    first = columns.arrays["sh"][: len(NAMES["sh"])].tolist()
    scales_and_logits = [*columns.arrays.get("scales", ()), *columns.arrays.get("opacities", ()), *first]
    telling = sorted(short & {int(column) for column in scales_and_logits})
    if not telling or not header.byte_order:
        return vertex
    record = np.dtype([(str(column), header.byte_order + code) for column, code in enumerate(codes)])
    file.seek(start)
    rows = np.fromfile(file, record, min(vertex.count, SAMPLE))
    if not len(rows) or max(np.median(np.abs(rows[str(column)].astype(int))) for column in telling) < TELLING:
        return vertex
    problem = f"its {len(short)} columns of 16-bit integers hold numbers of 16-bit floating point"
    warnings.warn(f"{path}: {problem}; they are read as such", LoadWarning, stacklevel=4)
    properties = tuple(
        replace(prop, code="f2") if column in short else prop for column, prop in enumerate(vertex.properties)
    )
    return replace(vertex, properties=properties)
