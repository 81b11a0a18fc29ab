"""The outside of an SPZ file: its header, and six packed streams unpacked to the byte, never further.

Source: the README of github.com/nianticlabs/spz. Versions 1 to 3 are one gzip stream, sometimes bare; version 4 is
a plain header, a table of sizes, and a zstd frame for each stream.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import cast

from tsplat.errors import CorruptFileError, LoadError

MAGIC = b"NGSP"
GZIP_MAGIC = b"\x1f\x8b"
HEADER = struct.Struct("<4sIIBBBB")
REST_COEFFICIENTS = (0, 3, 8, 15, 24)
"""How many coefficients follow the first one at degree 0 to 4."""

ANTIALIASED = 1
"""The one flag that adds nothing to the file; behind others, writers append what only they know."""

_MOST_DEFLATE = 1032
"""Deflate makes at most this many bytes of one, so a header that promises more lies."""

_TAIL_BYTES = 1 << 20
_PIECE_BYTES = 1 << 16

Take = Callable[[str, int], bytes | memoryview]
"""Gives the next stream, by its name for people and its exact size."""


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


def open_bare(path: Path, raw: bytes) -> tuple[Header, Take]:
    """Return header and streams of versions 1 to 3 without gzip around them."""
    header = parse_header(path, raw[: HEADER.size], (1, 2, 3))
    need, there = HEADER.size + sum(header.streams.values()), len(raw)
    if there < need or (there > need and not header.flags & ~ANTIALIASED):
        problem = f"{header.count} splats need {need} bytes, {there} are there; fetch it again"
        raise CorruptFileError(path, problem, min(need, there))
    rest = memoryview(raw)[HEADER.size :]

    def take(_: str, size: int) -> memoryview:
        nonlocal rest
        part, rest = rest[:size], rest[size:]
        return part

    return header, take


def open_gzip(path: Path, raw: bytes) -> tuple[Header, Take]:
    """Return header and streams of versions 1 to 3; the last stream checks the end of the file."""
    gunzip = _Gunzip(path, raw)
    header = parse_header(path, gunzip.read(HEADER.size), (1, 2, 3))
    sizes = header.streams
    need = HEADER.size + sum(sizes.values())
    if need > _MOST_DEFLATE * len(raw):
        problem = f"{header.count} splats need {need} bytes, more than {len(raw)} packed ones hold; fetch it again"
        raise CorruptFileError(path, problem, 8)
    left = len(sizes)

    def take(name: str, size: int) -> bytes:
        nonlocal left
        stream = gunzip.read(size)
        if len(stream) < size:
            problem = f"ends {len(stream)} bytes into the {size} of {name}; fetch it again"
            raise CorruptFileError(path, problem, len(raw))
        left -= 1
        if not left:
            gunzip.end(bool(header.flags & ~ANTIALIASED), need + _TAIL_BYTES)
        return stream

    return header, take


class _Gunzip:
    """A gzip stream read forwards, and no further than asked."""

    def __init__(self, path: Path, raw: bytes) -> None:
        from isal import isal_zlib

        self._path, self._rest = path, raw
        self._size = len(raw)
        self._stream = isal_zlib.decompressobj(wbits=31)
        self._error = cast("type[Exception]", isal_zlib.error)

    def read(self, size: int) -> bytes:
        """Return the next bytes; fewer where the stream ends."""
        parts = []
        while size > 0:  # a length of 0 would mean no limit
            try:
                part = self._stream.decompress(self._rest, size)
            except self._error as error:
                problem = f"does not unpack: {error}; fetch it again"
                raise CorruptFileError(self._path, problem, self._size - len(self._rest)) from error
            self._rest = self._stream.unconsumed_tail
            if not part:
                break
            parts.append(part)
            size -= len(part)
        return parts[0] if len(parts) == 1 else b"".join(parts)

    def end(self, more_may_follow: bool, most: int) -> None:
        """Require the end of the stream, and its checksum, here or behind at most so many bytes."""
        passed = 0
        while more := len(self.read(_PIECE_BYTES if more_may_follow else 1)):
            passed += more
            if not more_may_follow or passed > most:
                raise CorruptFileError(self._path, "holds more than its header says; fetch it again", self._size)
        if not self._stream.eof:
            raise CorruptFileError(self._path, "ends before its checksum; fetch it again", self._size)
