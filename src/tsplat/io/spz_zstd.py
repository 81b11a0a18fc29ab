"""SPZ of version 4: 32 plain bytes, what extensions say, a table of sizes, and a zstd frame for each stream.

Source: the README of github.com/nianticlabs/spz.
"""

from __future__ import annotations

import struct
from pathlib import Path

from tsplat.errors import CorruptFileError
from tsplat.io.spz_header import Header, Take

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


def open_zstd(path: Path, raw: bytes, header: Header) -> Take:
    """Return what gives the streams, after all sizes were checked.

    Raises
    ------
    CorruptFileError
        A size or a place contradicts the header or the length of the file.
    """
    sizes = list(header.streams.items())
    need = sum(header.streams.values())
    if need > _MOST_ZSTD * len(raw):
        problem = f"{header.count} splats need {need} bytes, more than {len(raw)} packed ones hold; fetch it again"
        raise CorruptFileError(path, problem, 8)
    if len(raw) < HEAD_BYTES:
        raise CorruptFileError(path, f"ends in a header of {HEAD_BYTES} bytes; fetch it again", len(raw))
    # Without harmonics there may be no stream for them.
    count, least = raw[STREAM_COUNT], len(sizes) - (header.sh_degree == 0)
    if not least <= count <= len(sizes):
        raise CorruptFileError(path, f"has {count} streams, expected {least}; fetch it again", STREAM_COUNT)
    start = int.from_bytes(raw[TABLE_START : TABLE_START + 4], "little")
    place = start + count * _ENTRY.size
    if start < HEAD_BYTES or place > len(raw):
        problem = f"has its table at byte {start}, expected {HEAD_BYTES} to {len(raw) - count * _ENTRY.size}"
        raise CorruptFileError(path, f"{problem}; fetch it again", TABLE_START)
    frames = {}
    for number, (name, size) in enumerate(sizes[:count]):
        entry = start + number * _ENTRY.size
        packed, unpacked = _ENTRY.unpack_from(raw, entry)
        if unpacked != size:
            raise CorruptFileError(
                path, f"says {unpacked} bytes of {name}, expected {size}; fetch it again", entry
            )
        if packed > len(raw) - place:
            problem = f"{packed} packed bytes of {name} begin at {place}, expected at most {len(raw) - place}"
            raise CorruptFileError(path, f"{problem}; fetch it again", entry)
        frames[name] = place, memoryview(raw)[place : place + packed]
        place += packed
    if place != len(raw):
        raise CorruptFileError(path, f"has {len(raw) - place} bytes behind the last stream; fetch it again", place)
    return lambda name, size: _unpack(path, name, size, *frames[name]) if name in frames else b""


def _unpack(path: Path, name: str, size: int, place: int, frame: memoryview) -> bytes:
    import zstandard

    try:
        # A frame may promise any size, and room for it would be made at once.
        promised = zstandard.frame_content_size(frame)
        if promised in (-1, size):
            unpacker = zstandard.ZstdDecompressor(max_window_size=max(_WINDOW_BYTES, 1 << size.bit_length()))
            stream = unpacker.decompress(frame, max_output_size=max(size, 1), allow_extra_data=False)
            promised = len(stream)
    except zstandard.ZstdError as error:
        raise CorruptFileError(path, f"{name} do not unpack: {error}; fetch it again", place) from error
    if promised != size:
        problem = f"{name} unpack to {promised} bytes, expected {size}; fetch it again"
        raise CorruptFileError(path, problem, place)
    return stream
