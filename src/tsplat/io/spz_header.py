"""The header of an SPZ file, and how many bytes of what follow it.

Source: the README of github.com/nianticlabs/spz.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from tsplat.errors import CorruptFileError, LoadError

MAGIC = b"NGSP"
GZIP_MAGIC = b"\x1f\x8b"
HEADER = struct.Struct("<4sIIBBBB")
REST_COEFFICIENTS = (0, 3, 8, 15, 24)
"""How many coefficients follow the first one at degree 0 to 4."""

ANTIALIASED = 1
"""The one flag that adds nothing to the file."""

RECORDS = 2
"""The flag of records as in `tsplat.io.spz_records`; for other flags, writers append what only they know."""


class Streams(Protocol):
    """The streams of a file, read forwards a piece at a time."""

    def read(self, name: str, size: int) -> bytes:
        """Return exactly the next bytes of a stream; they come in the order of `Header.streams`."""

    def end(self) -> None:
        """Require that nothing is left over once all was read."""

    def records(self) -> bytes:
        """Return what the file says beside its streams, once they have come to their end."""


@dataclass(frozen=True, slots=True)
class Header:
    """The fields that every version has.

    Attributes
    ----------
    version : int
        1 to 4.
    count : int
        How many splats there are.
    sh_degree : int
        0 to 4.
    fractional_bits : int
        Bits behind the point of a mean's 24, 0 to 24.
    flags : int
        Bits; see `ANTIALIASED`.
    """

    version: int
    count: int
    sh_degree: int
    fractional_bits: int
    flags: int

    @property
    def streams(self) -> dict[str, int]:
        """Names of the streams, in the order of the file, and their sizes in bytes."""
        widths = {
            "means": 6 if self.version == 1 else 9,
            "opacities": 1,
            "colours": 3,
            "scales": 3,
            "quats": 3 if self.version < 3 else 4,
            "sh": 3 * REST_COEFFICIENTS[self.sh_degree],
        }
        return {name: width * self.count for name, width in widths.items()}

    @property
    def need(self) -> int:
        """How many bytes all streams have."""
        return sum(self.streams.values())


def parse_header(path: Path, head: bytes, versions: tuple[int, ...]) -> Header:
    """Return the first 16 bytes as a header, every field in its range.

    Raises
    ------
    CorruptFileError
        It is no header, ends early, or a field is out of its range.
    LoadError
        The version is not known.
    """
    if len(head) < HEADER.size:
        raise CorruptFileError(path, f"ends in a header of {HEADER.size} bytes; fetch it again", len(head))
    magic, version, count, sh_degree, fractional_bits, flags, _ = HEADER.unpack_from(head)
    if magic != MAGIC:
        raise CorruptFileError(path, f"begins with {magic!r}, expected {MAGIC!r}; fetch it again", 0)
    if version not in versions:
        known = f"{versions[0]} to {versions[-1]}" if len(versions) > 1 else f"{versions[0]}"
        raise LoadError(path, f"is SPZ of version {version}, expected {known}; convert it first", 4)
    if sh_degree >= len(REST_COEFFICIENTS):
        raise CorruptFileError(path, f"has SH degree {sh_degree}, expected 0 to 4; fetch it again", 12)
    if fractional_bits > 24:
        raise CorruptFileError(
            path, f"has {fractional_bits} fractional bits, expected 0 to 24; fetch it again", 13
        )
    return Header(version, count, sh_degree, fractional_bits, flags)
