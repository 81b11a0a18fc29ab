"""SPZ of versions 1 to 3: six streams behind a header in one gzip stream, unpacked to the byte, never further.

Source: the README of github.com/nianticlabs/spz. Files without the gzip around them are about, too.
"""

from __future__ import annotations

from pathlib import Path
from typing import cast

from tsplat.errors import CorruptFileError
from tsplat.io.spz_header import ANTIALIASED, HEADER, Header, Take, parse_header

_MOST_DEFLATE = 1032
"""Deflate makes at most this many bytes of one, so a header that promises more lies."""

_TAIL_BYTES = 1 << 20
_PIECE_BYTES = 1 << 16


def open_bare(path: Path, raw: bytes, header: Header) -> Take:
    """Return what gives the streams of a file without gzip."""
    need, there = HEADER.size + sum(header.streams.values()), len(raw)
    if there < need or (there > need and not header.flags & ~ANTIALIASED):
        problem = f"{header.count} splats need {need} bytes, {there} are there; fetch it again"
        raise CorruptFileError(path, problem, min(need, there))
    rest = memoryview(raw)[HEADER.size :]

    def take(_: str, size: int) -> memoryview:
        nonlocal rest
        part, rest = rest[:size], rest[size:]
        return part

    return take


def open_gzip(path: Path, raw: bytes) -> tuple[Header, Take]:
    """Return the header and what gives the streams; the last one checks the end of the file."""
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
