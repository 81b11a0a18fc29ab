"""The header of a .tsplat file: how many splats there are, and where each array of them lies.

docs/tsplat-format.md describes the layout, which is our own.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tsplat.errors import CorruptFileError, LoadError
from tsplat.scene import SH_COEFFICIENTS

MAGIC = b"TSPLAT\r\n"
"""Its last two bytes are what a transfer as text would change."""

VERSION = 2
HEADER = struct.Struct("<8sIIQQIIII12xI")
SECTION = struct.Struct("<16sQQI4x")

MOST_SECTIONS = 64
"""More than any version is going to have; the table is read before its checksum is known to be right."""

BLOCK = 256
"""Splats of a block; the last one of a level is filled up with splats that are never seen."""

ALIGNMENT = 4096
"""Sections start at multiples of a page of memory, so that reading one brings in nothing of another."""

LEAST_ALIGNMENT = 64
"""What readers ask for: a cache line, as the kernels do."""

ANTIALIASED = 1


@dataclass(frozen=True, slots=True)
class Counts:
    """What the sizes of all sections follow from.

    Attributes
    ----------
    splats : int
        In the scene, which is the finest level.
    blocks : int
        Of all levels; the first ones are those of the finest.
    coefficients : int
        Spherical harmonics above the constant one: 0, 3, 8, 15 or 24.
    sampled : int
        Splats that stand for the scene when it is framed.
    """

    splats: int
    blocks: int
    coefficients: int
    sampled: int

    @property
    def padded(self) -> int:
        """Splats of all blocks."""
        return self.blocks * BLOCK

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        return sum(nbytes_of(*each) for each in self.arrays.values())

    @property
    def arrays(self) -> dict[str, tuple[str, int]]:
        """The dtype and the length of each section's array, flat, in the order of the file."""
        f4, n, some = "<f4", self.splats, self.sampled
        return {
            "sample_means": (f4, 3 * some),
            "sample_quats": (f4, 4 * some),
            "sample_scales": (f4, 3 * some),
            "sample_opacities": (f4, some),
            "bounds": (f4, 5 * self.blocks),
            "sizes": (f4, self.blocks),
            "errors": (f4, self.blocks),
            "solidities": (f4, self.blocks),
            "means": (f4, 3 * self.padded),
            "covars": (f4, 6 * self.padded),
            "log2_opacities": (f4, self.padded),
            "base_colors": (f4, 3 * self.padded),
            "sh_rest": ("<u2", 3 * self.coefficients * self.padded),
            "quats": (f4, 4 * n),
            "scales": (f4, 3 * n),
            "opacities": (f4, n),
            "sh_first": (f4, 3 * n),
        }


OPTIONAL = {"origin": ("<f8", 3), "up": ("<f8", 3)}
"""Sections of scenes that have such, as in `tsplat.scene.Gaussians`; other readers pass over them."""


class Section(NamedTuple):
    """Where an array lies in the file, in bytes, and the CRC-32 of it."""

    offset: int
    nbytes: int
    checksum: int


@dataclass(frozen=True, slots=True)
class Header:
    """All that is known of a file once it is open.

    Attributes
    ----------
    counts : Counts
        How much there is.
    antialiased : bool
        As in `tsplat.scene.Gaussians`.
    sections : mapping of str to Section
        One for each of ``counts.arrays``, and of `OPTIONAL` those that there are.
    """

    counts: Counts
    antialiased: bool
    sections: Mapping[str, Section]


def header_bytes(sections: int) -> int:
    """Return how long a header with so many sections is."""
    return HEADER.size + sections * SECTION.size


def packed(header: Header) -> bytes:
    """Return a header as bytes."""
    table = b"".join(SECTION.pack(name.encode(), *section) for name, section in header.sections.items())
    counts, flags = header.counts, ANTIALIASED * header.antialiased
    fields = (counts.splats, counts.blocks, counts.coefficients, flags, counts.sampled, len(header.sections))
    checksum = zlib.crc32(HEADER.pack(MAGIC, VERSION, BLOCK, *fields, 0) + table)
    return HEADER.pack(MAGIC, VERSION, BLOCK, *fields, checksum) + table


def parse(path: Path, head: bytes, size: int) -> Header:
    """Return the header of a file of ``size`` bytes, with every section inside of it.

    Parameters
    ----------
    path : Path
        The file, for errors.
    head : bytes
        Its beginning, at least ``header_bytes(MOST_SECTIONS)`` of it, or all where it is shorter.
    size : int
        Of the file.

    Raises
    ------
    LoadError
        It is of another version.
    CorruptFileError
        It ends early, or what it says contradicts itself.
    """
    if len(head) < HEADER.size:
        raise CorruptFileError(path, f"ends in a header of {HEADER.size} bytes; fetch it again", len(head))
    magic, version, block, *fields, checksum = HEADER.unpack_from(head)
    if magic != MAGIC:
        raise CorruptFileError(path, f"begins with {magic!r}, expected {MAGIC!r}; fetch it again", 0)
    if version != VERSION:
        problem = f"is .tsplat of version {version}, expected {VERSION}; make it again with tsplat optimize"
        raise LoadError(path, problem, 8)
    splats, blocks, coefficients, flags, sampled, sections = fields
    if sections > MOST_SECTIONS:
        problem = f"has {sections} sections, expected at most {MOST_SECTIONS}; fetch it again"
        raise CorruptFileError(path, problem, 44)
    end = header_bytes(sections)
    if len(head) < end:
        raise CorruptFileError(path, f"ends in a header of {end} bytes; fetch it again", len(head))
    without = head[: HEADER.size - 4] + bytes(4) + head[HEADER.size : end]
    if zlib.crc32(without) != checksum:
        raise CorruptFileError(path, "header is not what its checksum says; fetch it again", HEADER.size - 4)
    _expect(path, block == BLOCK, f"has blocks of {block} splats, expected {BLOCK}", 12)
    _expect(path, 1 <= splats <= BLOCK * blocks, f"has {splats} splats in {blocks} blocks, expected 1 or more", 16)
    _expect(path, coefficients + 1 in SH_COEFFICIENTS, f"has {coefficients} harmonics, expected 0 to 24", 32)
    _expect(path, flags <= ANTIALIASED, f"has flags {flags:#x}, expected at most {ANTIALIASED:#x}", 36)
    _expect(path, 1 <= sampled <= splats, f"has {sampled} splats in its sample, expected 1 to {splats}", 40)
    counts = Counts(splats, blocks, coefficients, sampled)
    return Header(counts, bool(flags & ANTIALIASED), _sections(path, head[:end], counts, size))


def _sections(path: Path, head: bytes, counts: Counts, size: int) -> dict[str, Section]:
    """Return those sections that are known, each as large as it must be, and where no other is."""
    wanted, found, end = counts.arrays, {}, len(head)
    for at in range(HEADER.size, len(head), SECTION.size):
        raw, *numbers = SECTION.unpack_from(head, at)
        name, section = raw.rstrip(b"\0").decode("latin-1"), Section(*numbers)
        lies = f"has section {name!r} at byte {section.offset}, expected"
        _expect(path, section.offset >= end, f"{lies} {end} or more", at + 16)
        _expect(path, section.offset % LEAST_ALIGNMENT == 0, f"{lies} a multiple of {LEAST_ALIGNMENT}", at + 16)
        end = section.offset + section.nbytes
        _expect(path, end <= size, f"has section {name!r} up to byte {end}, but ends at {size}", at + 24)
        if name in wanted | OPTIONAL:
            nbytes = nbytes_of(*(wanted | OPTIONAL)[name])
            _expect(path, section.nbytes == nbytes,
                    f"has section {name!r} of {section.nbytes} bytes, expected {nbytes}", at + 24)  # fmt: skip
            found[name] = section
    for name in wanted:
        _expect(path, name in found, f"has no section {name!r}", HEADER.size)
    return found


def nbytes_of(dtype: str, length: int) -> int:
    """Return the bytes of so many values."""
    return np.dtype(dtype).itemsize * length


def next_section(offset: int) -> int:
    """Return where a section may start that comes after this byte."""
    return math.ceil(offset / ALIGNMENT) * ALIGNMENT


def _expect(path: Path, valid: bool, problem: str, offset: int) -> None:
    if not valid:
        raise CorruptFileError(path, f"{problem}; fetch it again", offset)
