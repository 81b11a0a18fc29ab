"""SPZ of version 4: 32 plain bytes, what extensions say, a table of sizes, and a zstd frame for each stream.

Source: the README of github.com/nianticlabs/spz.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import IO, BinaryIO, NamedTuple, cast

from tsplat.errors import CorruptFileError
from tsplat.io.spz_header import Header

HEAD_BYTES = 32
STREAM_COUNT = 15
"""Byte that says how many streams there are."""

TABLE_START = 16
"""Four bytes that say where the table begins."""

_ENTRY = struct.Struct("<QQ")
_MOST_ZSTD = 1024
"""No scene packs to so little of itself; the reference, too, refuses files that promise so much."""

_WINDOW_BYTES = 1 << 23
"""What RFC 8878 asks every decoder to have for a window."""

_FRAME_HEADER_BYTES = 18
_RECORD_BYTES = 1 << 20


class Frame(NamedTuple):
    """Where the frame of a stream is, and what it holds.

    Attributes
    ----------
    name : str
        Of its stream.
    place, packed : int
        Its first byte in the file, and how many it takes.
    size : int
        How many bytes the stream has.
    """

    name: str
    place: int
    packed: int
    size: int


class ZstdStreams:
    """The streams of a file, after all sizes were checked.

    Raises
    ------
    CorruptFileError
        A size or a place contradicts the header or the length of the file.
    """

    def __init__(self, path: Path, file: BinaryIO, size: int, header: Header) -> None:
        self._path, self._file = path, file
        self._frames = _find_frames(path, file, size, header)
        self._open: _Unpacker | None = None

    def read(self, name: str, size: int) -> bytes:
        """Return the next bytes."""
        if self._open is None or self._open.frame.name != name:
            self.end()
            self._open = _Unpacker(self._path, self._file, self._frames[name])
        return self._open.read(size)

    def end(self) -> None:
        """Require the end of the frame that is open."""
        if self._open:
            self._open.end()

    def records(self) -> bytes:
        """Return what extensions say between the header and the table, at most a megabyte of it."""
        self._file.seek(TABLE_START)
        start = int.from_bytes(self._file.read(4), "little")
        self._file.seek(HEAD_BYTES)
        return self._file.read(min(start - HEAD_BYTES, _RECORD_BYTES))


class _Unpacker:
    """A frame that is read forwards."""

    def __init__(self, path: Path, file: BinaryIO, frame: Frame) -> None:
        import zstandard

        self.frame, self._path = frame, path
        self._error = zstandard.ZstdError
        self._packed = _Section(file, frame)
        try:
            # A frame may promise any size, and room for it would be made at once.
            promised = zstandard.frame_content_size(self._packed.read(_FRAME_HEADER_BYTES))
        except zstandard.ZstdError as error:
            raise self._wrong(f"do not unpack: {error}") from error
        if promised not in (-1, frame.size):
            raise self._wrong_size(promised)
        self._packed = _Section(file, frame)
        window = max(_WINDOW_BYTES, 1 << frame.size.bit_length())
        unpacker = zstandard.ZstdDecompressor(max_window_size=window)
        source = cast("IO[bytes]", self._packed)
        self._stream = unpacker.stream_reader(source, read_across_frames=True)

    def read(self, size: int) -> bytes:
        """Return exactly the next bytes."""
        piece = self._read(size)
        if len(piece) < size:
            raise self._wrong_size(self._stream.tell())
        return piece

    def end(self) -> None:
        """Require that nothing is left."""
        if self._read(1):
            raise self._wrong("do not unpack: they go on behind their end")

    def _read(self, size: int) -> bytes:
        try:
            return self._stream.read(size)
        except self._error as error:
            raise self._wrong(f"do not unpack: {error}") from error

    def _wrong_size(self, size: int) -> CorruptFileError:
        return self._wrong(f"unpack to {size} bytes, expected {self.frame.size}")

    def _wrong(self, problem: str) -> CorruptFileError:
        return CorruptFileError(self._path, f"{self.frame.name} {problem}; fetch it again", self.frame.place)


class _Section:
    """The bytes of a frame in a file, and no others."""

    def __init__(self, file: BinaryIO, frame: Frame) -> None:
        self._file, self._left = file, frame.packed
        file.seek(frame.place)

    def read(self, size: int) -> bytes:
        piece = self._file.read(min(size, self._left))
        self._left -= len(piece)
        return piece


def _find_frames(path: Path, file: BinaryIO, length: int, header: Header) -> dict[str, Frame]:
    sizes = list(header.streams.items())
    if header.need > _MOST_ZSTD * length:
        problem = f"{header.count} splats need {header.need} bytes, more than {length} packed ones hold"
        raise CorruptFileError(path, f"{problem}; fetch it again", 8)
    if length < HEAD_BYTES:
        raise CorruptFileError(path, f"ends in a header of {HEAD_BYTES} bytes; fetch it again", length)
    file.seek(0)
    head = file.read(HEAD_BYTES)
    # Without harmonics there may be no stream for them.
    count, least = head[STREAM_COUNT], len(sizes) - (header.sh_degree == 0)
    if not least <= count <= len(sizes):
        raise CorruptFileError(path, f"has {count} streams, expected {least}; fetch it again", STREAM_COUNT)
    start = int.from_bytes(head[TABLE_START : TABLE_START + 4], "little")
    place = start + count * _ENTRY.size
    if start < HEAD_BYTES or place > length:
        problem = f"has its table at byte {start}, expected {HEAD_BYTES} to {length - count * _ENTRY.size}"
        raise CorruptFileError(path, f"{problem}; fetch it again", TABLE_START)
    file.seek(start)
    frames = {}
    for number, (name, size) in enumerate(sizes[:count]):
        entry = start + number * _ENTRY.size
        packed, unpacked = _ENTRY.unpack(file.read(_ENTRY.size))
        if unpacked != size:
            raise CorruptFileError(
                path, f"says {unpacked} bytes of {name}, expected {size}; fetch it again", entry
            )
        if packed > length - place:
            problem = f"{packed} packed bytes of {name} begin at {place}, expected at most {length - place}"
            raise CorruptFileError(path, f"{problem}; fetch it again", entry)
        frames[name] = Frame(name, place, packed, size)
        place += packed
    if place != length:
        raise CorruptFileError(path, f"has {length - place} bytes behind the last stream; fetch it again", place)
    return frames
