"""SPZ of versions 1 to 3: six streams behind a header in one gzip stream, unpacked to the byte, never further.

Source: the README of github.com/nianticlabs/spz. Files without the gzip around them are about, too.
"""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO, cast

from tsplat.errors import CorruptFileError
from tsplat.io.spz_header import ANTIALIASED, HEADER, Header, parse_header

_MOST_DEFLATE = 1032
"""Deflate makes at most this many bytes of one, so a header that promises more lies."""

_TAIL_BYTES = 1 << 20
_PIECE_BYTES = 1 << 16


class BareStreams:
    """The streams of a file without gzip; the file is behind its header.

    Raises
    ------
    CorruptFileError
        The file is of another length than its header says.
    """

    def __init__(self, path: Path, file: BinaryIO, size: int, header: Header) -> None:
        need = HEADER.size + header.need
        if size < need or (size > need and not header.flags & ~ANTIALIASED):
            problem = f"{header.count} splats need {need} bytes, {size} are there; fetch it again"
            raise CorruptFileError(path, problem, min(need, size))
        self._path, self._file, self._behind = path, file, size - need

    def read(self, name: str, size: int) -> bytes:
        """Return the next bytes."""
        piece = self._file.read(size)
        if len(piece) < size:
            raise CorruptFileError(self._path, f"ends in {name}; fetch it again", self._file.tell())
        return piece

    def end(self) -> None:
        """Let be: the length was checked before."""

    def records(self) -> bytes:
        """Return what extensions appended."""
        return self._file.read(min(self._behind, _TAIL_BYTES))


class GzipStreams:
    """The header and the streams of a file in gzip.

    Raises
    ------
    CorruptFileError
        It does not unpack, or so few bytes cannot hold what the header says.
    """

    def __init__(self, path: Path, file: BinaryIO, size: int) -> None:
        self._path, self._size = path, size
        self._gunzip = _Gunzip(path, file)
        self.header = header = parse_header(path, self._gunzip.read(HEADER.size), (1, 2, 3))
        need = HEADER.size + header.need
        if need > _MOST_DEFLATE * size:
            problem = f"{header.count} splats need {need} bytes, more than {size} packed ones hold; fetch it again"
            raise CorruptFileError(path, problem, 8)
        self._left = header.streams
        self._behind = b""

    def read(self, name: str, size: int) -> bytes:
        """Return the next bytes."""
        piece = self._gunzip.read(size)
        self._left[name] -= len(piece)
        if len(piece) < size:
            whole = self.header.streams[name]
            problem = f"ends {whole - self._left[name]} bytes into the {whole} of {name}; fetch it again"
            raise CorruptFileError(self._path, problem, self._size)
        return piece

    def end(self) -> None:
        """Require the end of the stream, and its checksum, here or behind what extensions may append."""
        more_may_follow = bool(self.header.flags & ~ANTIALIASED)
        self._behind = self._gunzip.read(_TAIL_BYTES if more_may_follow else 0)
        most = HEADER.size + self.header.need
        passed = 0
        while more := len(self._gunzip.read(_PIECE_BYTES if more_may_follow else 1)):
            passed += more
            if not more_may_follow or passed > most:
                raise CorruptFileError(self._path, "holds more than its header says; fetch it again", self._size)
        if not self._gunzip.ended:
            raise CorruptFileError(self._path, "ends before its checksum; fetch it again", self._size)

    def records(self) -> bytes:
        """Return what extensions appended, at most a megabyte of it."""
        return self._behind


class _Gunzip:
    """A gzip stream read forwards, and no further than asked."""

    def __init__(self, path: Path, file: BinaryIO) -> None:
        from isal import isal_zlib

        self._path, self._file, self._rest = path, file, b""
        self._stream = isal_zlib.decompressobj(wbits=31)
        self._error = cast("type[Exception]", isal_zlib.error)

    @property
    def ended(self) -> bool:
        """Whether the checksum was reached, and is right."""
        return bool(self._stream.eof)

    def read(self, size: int) -> bytes:
        """Return the next bytes; fewer where the stream ends."""
        parts = []
        while size > 0 and not self.ended:  # a length of 0 would mean no limit
            packed = self._rest or self._file.read(_PIECE_BYTES)
            try:
                part = self._stream.decompress(packed, size)
            except self._error as error:
                problem = f"does not unpack: {error}; fetch it again"
                raise CorruptFileError(self._path, problem, self._file.tell() - len(packed)) from error
            self._rest = self._stream.unconsumed_tail
            if not part and not packed:
                break
            parts.append(part)
            size -= len(part)
        return parts[0] if len(parts) == 1 else b"".join(parts)
