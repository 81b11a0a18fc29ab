"""What a ``.ksplat`` says of itself: where the splats of each section lie, and how they are packed.

Source: mkkellogg/GaussianSplats3D, ``SplatBuffer``: a header of 4096 bytes, one of 1024 for each section, then
for each section the lengths of its partly filled buckets, the centres of all its buckets, and its splats.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from tsplat.errors import CorruptFileError, LoadError

VERSION = (0, 1)

HEADER_BYTES = 4096
HEADER = {
    "major": ("u1", 0),
    "minor": ("u1", 1),
    "sections": ("<u4", 4),
    "max_splats": ("<u4", 12),
    "splats": ("<u4", 16),
    "level": ("<u2", 20),
    "sh_low": ("<f4", 36),
    "sh_high": ("<f4", 40),
}
"""Type and place of each field of the header that is used."""

SECTION_BYTES = 1024
SECTION = {
    "splats": ("<u4", 0),
    "max_splats": ("<u4", 4),
    "bucket_size": ("<u4", 8),
    "buckets": ("<u4", 12),
    "block": ("<f4", 16),
    "bucket_bytes": ("<u2", 20),
    "steps": ("<u4", 24),
    "full_buckets": ("<u4", 32),
    "partial_buckets": ("<u4", 36),
    "sh_degree": ("<u2", 40),
}
"""The same of the header of a section."""

FLOATS = ("<f4", "<f2", "<f2")
"""How scales and quats are stored at each compression level."""

MEANS = ("<f4", "<u2", "<u2")
HARMONICS_COUNTS = (1, 4, 9, 16)
"""Coefficients of a colour by degree: the format ends at 3."""

HARMONICS = ("<f4", "<f2", "u1")

BUCKET_BYTES = 12
"""A bucket is the centre of a cube, in float32."""

DEFAULT_STEPS = 32767
"""Half as many steps as a compressed coordinate has, where a section does not say."""

DEFAULT_SH_RANGE = 1.5


@dataclass(frozen=True, slots=True)
class Section:
    """Where the splats of a section are and how they are packed.

    Attributes
    ----------
    count : int
        How many splats.
    sh_degree : int
        Of its colours, 0 to 3.
    record : dtype
        One splat: means, scales, quats, rgba, and sh where the degree is not 0.
    start : int
        Byte of the first splat.
    buckets_start : int
        Byte of the lengths of the partly filled buckets; the centres of all buckets follow.
    buckets, bucket_size, full_buckets, partial_buckets : int
        How many buckets, how many splats a full one holds, how many are full, and how many are not.
    block : float
        Edge of a bucket's cube in world units.
    steps : int
        What a compressed coordinate is at the centre of its bucket.
    """

    count: int
    sh_degree: int
    record: np.dtype[np.void]
    start: int
    buckets_start: int
    buckets: int
    bucket_size: int
    full_buckets: int
    partial_buckets: int
    block: float
    steps: int


@dataclass(frozen=True, slots=True)
class Header:
    """The headers of a file, checked against its size.

    Attributes
    ----------
    count : int
        Splats in all sections.
    level : int
        Compression level: 0 is float32, 1 is 16 bits, 2 has harmonics of 8 bits as well.
    sh_range : tuple of 2 float
        What 0 and 255 mean for a harmonic at level 2.
    by_channel : bool
        All harmonics of red come first; else those of the first degree do.
    sections : tuple of Section
        In file order.
    """

    count: int
    level: int
    sh_range: tuple[float, float]
    by_channel: bool
    sections: tuple[Section, ...]


def read_header(file: BinaryIO, path: Path) -> Header:
    """Read and check all headers.

    Raises
    ------
    LoadError
        It is of a version that is not read here.
    CorruptFileError
        A field is out of its range, or the file is too short for what it announces.
    """
    size = os.fstat(file.fileno()).st_size
    raw = file.read(HEADER_BYTES)
    if len(raw) < HEADER_BYTES:
        raise _corrupt(path, f"header: {len(raw)} bytes, expected {HEADER_BYTES}", 0)
    fields = _fields(raw, HEADER)
    if (fields["major"], fields["minor"]) != VERSION:
        problem = (
            f"version {fields['major']}.{fields['minor']}, expected {VERSION[0]}.{VERSION[1]}; convert it first"
        )
        raise LoadError(path, problem, 0)
    level, n = int(fields["level"]), int(fields["sections"])
    if level >= len(FLOATS):
        raise _corrupt(path, f"compression level {level}, expected 0, 1 or 2", HEADER["level"][1])
    low, high = fields["sh_low"] or -DEFAULT_SH_RANGE, fields["sh_high"] or DEFAULT_SH_RANGE
    if level == 2 and not math.isfinite(low + high):
        raise _corrupt(path, f"harmonics: range {low:g} to {high:g}, expected numbers", HEADER["sh_low"][1])
    start = HEADER_BYTES + n * SECTION_BYTES
    if start > size:
        raise _corrupt(path, f"sections: {n} need {start} bytes, expected at most {size}", HEADER["sections"][1])
    sections = []
    for where in range(HEADER_BYTES, start, SECTION_BYTES):
        section, start = _section(path, file.read(SECTION_BYTES), level, where, start)
        if start > size:
            raise _corrupt(path, f"section: ends at byte {start}, expected at most {size}", where)
        sections.append(section)
    total = sum(section.count for section in sections)
    if total != fields["splats"]:
        problem = f"splats: {fields['splats']:.0f}, expected {total} as the sections hold"
        raise _corrupt(path, problem, HEADER["splats"][1])
    # GaussForge leaves this count empty, and differs from the original viewer in the order of harmonics.
    by_channel = level == 0 and fields["max_splats"] == 0
    return Header(total, level, (low, high), by_channel, tuple(sections))


def _section(path: Path, raw: bytes, level: int, where: int, start: int) -> tuple[Section, int]:
    # Returns the section whose header is at byte `where` and contents at `start`, and where the contents end.
    if len(raw) < SECTION_BYTES:
        raise _corrupt(path, f"section: header of {len(raw)} bytes, expected {SECTION_BYTES}", where)
    fields = _fields(raw, SECTION)
    count, most, degree = int(fields["splats"]), int(fields["max_splats"]), int(fields["sh_degree"])
    if degree >= len(HARMONICS_COUNTS):
        raise _corrupt(path, f"sh degree {degree}, expected 0 to 3", where + SECTION["sh_degree"][1])
    if count > most:
        raise _corrupt(path, f"section: {count} splats, expected at most its largest number, {most}", where)
    full, partial, buckets = (int(fields[name]) for name in ("full_buckets", "partial_buckets", "buckets"))
    bucket_bytes, block = int(fields["bucket_bytes"]), fields["block"]
    if level and count:
        if buckets and bucket_bytes != BUCKET_BYTES:
            problem = f"bucket of {bucket_bytes} bytes, expected {BUCKET_BYTES}"
            raise _corrupt(path, problem, where + SECTION["bucket_bytes"][1])
        if full + partial > buckets:
            problem = f"buckets: {full} full and {partial} other ones, expected at most {buckets}"
            raise _corrupt(path, problem, where + SECTION["full_buckets"][1])
        if not 0.0 < block < math.inf:
            problem = f"block of size {block:g}, expected a length above 0"
            raise _corrupt(path, problem, where + SECTION["block"][1])
    record = _record(level, degree)
    data = start + 4 * partial + bucket_bytes * buckets
    steps = int(fields["steps"]) or DEFAULT_STEPS
    section = Section(
        count, degree, record, data, start, buckets, int(fields["bucket_size"]), full, partial, block, steps
    )
    return section, data + record.itemsize * most


def _fields(raw: bytes, layout: dict[str, tuple[str, int]]) -> dict[str, float]:
    return {name: np.frombuffer(raw, code, 1, offset).item() for name, (code, offset) in layout.items()}


def _record(level: int, sh_degree: int) -> np.dtype[np.void]:
    real = FLOATS[level]
    fields = [("means", MEANS[level], 3), ("scales", real, 3), ("quats", real, 4), ("rgba", "u1", 4)]
    if sh_degree:
        fields.append(("sh", HARMONICS[level], 3 * (HARMONICS_COUNTS[sh_degree] - 1)))
    return np.dtype(fields)


def _corrupt(path: Path, problem: str, offset: int) -> CorruptFileError:
    return CorruptFileError(path, f"{problem}; fetch it again", offset)
