"""PLY files made by hand for the tests, and a slow reader that is plain to see through."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

FORMATS = ("binary_little_endian", "binary_big_endian", "ascii")
STRUCT_CODES = {
    **dict.fromkeys(("char", "int8"), "b"),
    **dict.fromkeys(("uchar", "uint8"), "B"),
    **dict.fromkeys(("short", "int16"), "h"),
    **dict.fromkeys(("ushort", "uint16"), "H"),
    **dict.fromkeys(("int", "int32"), "i"),
    **dict.fromkeys(("uint", "uint32"), "I"),
    **dict.fromkeys(("float", "float32"), "f"),
    **dict.fromkeys(("double", "float64"), "d"),
}

BASE = ("x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity")
SHAPE = ("scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3")


def splat_names(sh_degree: int) -> tuple[str, ...]:
    """Return the columns of a splat file of this degree, in the order training writes them."""
    rest = 3 * ((sh_degree + 1) ** 2 - 1)
    return (*BASE[:6], *(f"f_rest_{i}" for i in range(rest)), BASE[6], *SHAPE)


@dataclass
class Table:
    """An element: columns as (type, name), a list as ("list uchar int", name), and rows of values."""

    name: str
    columns: Sequence[tuple[str, str]]
    rows: Sequence[Sequence[Any]] = field(default_factory=list)


def splats(rows: Sequence[Sequence[float]], sh_degree: int = 0, scalar: str = "float") -> Table:
    """Return vertices in the usual order of columns."""
    return Table("vertex", [(scalar, name) for name in splat_names(sh_degree)], rows)


def one_splat(**values: float) -> list[float]:
    """Return a row of degree 0: an identity at the origin, except for the given values."""
    return [{"rot_0": 1.0, **values}.get(name, 0.0) for name in splat_names(0)]


def header_lines(kind: str, tables: Sequence[Table]) -> list[str]:
    """Return the lines of a header, end_header included."""
    lines = ["ply", f"format {kind} 1.0", "comment made for a test", "obj_info nothing"]
    for table in tables:
        lines += [f"element {table.name} {len(table.rows)}", *(f"property {t} {n}" for t, n in table.columns)]
    return [*lines, "end_header"]


def ply_bytes(tables: Sequence[Table], kind: str = "binary_little_endian", newline: str = "\n") -> bytes:
    """Return a whole file."""
    head = "".join(line + newline for line in header_lines(kind, tables)).encode("ascii")
    return head + b"".join(row_bytes(table, row, kind, newline) for table in tables for row in table.rows)


def row_bytes(table: Table, row: Sequence[Any], kind: str, newline: str = "\n") -> bytes:
    """Return one row."""
    order = ">" if kind == "binary_big_endian" else "<"
    words, parts = [], []
    for (scalar, _), value in zip(table.columns, row, strict=True):
        if scalar.startswith("list "):
            _, length, item = scalar.split()
            words += [str(len(value)), *map(repr, value)]
            parts.append(struct.pack(order + STRUCT_CODES[length], len(value)))
            parts += [struct.pack(order + STRUCT_CODES[item], each) for each in value]
        else:
            words.append(repr(value))
            parts.append(struct.pack(order + STRUCT_CODES[scalar], value))
    return (" ".join(words) + newline).encode("ascii") if kind == "ascii" else b"".join(parts)


def in_halves(table: Table, scalar: str = "ushort", kind: str = "binary_little_endian") -> bytes:
    """Return a file of which all columns are halves, and said to be of a type of 16-bit integers."""
    order = ">" if kind == "binary_big_endian" else "<"
    head = Table(table.name, [(scalar, name) for _, name in table.columns], table.rows)
    lines = "".join(line + "\n" for line in header_lines(kind, [head])).encode("ascii")
    return lines + b"".join(struct.pack(f"{order}{len(row)}e", *row) for row in table.rows)


def decoded(row: dict[str, float]) -> dict[str, list[float]]:
    """Return what a splat's columns mean: the slow twin of the loader, one number at a time."""
    quat = [row[f"rot_{i}"] for i in range(4)]
    norm = math.sqrt(sum(q * q for q in quat))
    rest = sum(name.startswith("f_rest_") for name in row) // 3
    sh = [row[f"f_dc_{channel}"] for channel in range(3)]
    for coefficient in range(rest):
        sh += [row[f"f_rest_{channel * rest + coefficient}"] for channel in range(3)]
    return {
        "means": [row["x"], row["y"], row["z"]],
        "quats": [q / norm for q in quat],
        "scales": [math.exp(row[f"scale_{i}"]) for i in range(3)],
        "opacities": [1.0 / (1.0 + math.exp(-row["opacity"]))],
        "sh": sh,
    }


def read_slowly(raw: bytes, rows: int) -> list[dict[str, float]]:
    """Return the first vertices of a little-endian file whose only columns are floats."""
    head, body = raw.split(b"end_header\n", 1)
    names = [line.split()[2].decode() for line in head.splitlines() if line.startswith(b"property float")]
    size = 4 * len(names)
    return [
        dict(zip(names, struct.unpack_from(f"<{len(names)}f", body, row * size), strict=True))
        for row in range(rows)
    ]
