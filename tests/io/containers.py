"""What is packed inside a file, to be changed and packed again with sums that fit.

A change to packed bytes mostly ends at a checksum; one to what is inside of them reaches the reader.
"""

from __future__ import annotations

import contextlib
import gzip
import io
import struct
import zipfile
import zlib
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import zstandard
from PIL import Image

from tests.io.gltfs import glb
from tests.io.sogs import webp, zipped
from tests.io.tsplats import TABLE_AT, mended
from tsplat.io.tsplat_header import header_bytes

MOST_BYTES = 1 << 20
"""Containers that hold more are left closed: a change is to be made in no time."""

BROKEN = (
    *(OSError, EOFError, ValueError, RuntimeError, NotImplementedError, SyntaxError),
    *(zlib.error, struct.error, zipfile.BadZipFile, zstandard.ZstdError),
    *(Image.DecompressionBombError, Image.DecompressionBombWarning),
)
"""What a container that is damaged itself makes its library raise."""


class Opened(NamedTuple):
    """Parts of a container, and what packs so many parts again."""

    parts: list[bytes]
    pack: Callable[[Sequence[bytes]], bytes]


def opened(raw: bytes) -> Opened | None:
    """Return what is inside, by the first bytes, or None where it is no container or a broken one."""
    for magic, opener in OPENERS.items():
        if raw.startswith(magic):
            with contextlib.suppress(*BROKEN):
                return opener(raw)
    return None


def _open_gzip(raw: bytes) -> Opened:
    with gzip.open(io.BytesIO(raw)) as file:
        return Opened([file.read(MOST_BYTES)], lambda parts: gzip.compress(parts[0], 1, mtime=0))


def _open_zip(raw: bytes) -> Opened:
    with zipfile.ZipFile(io.BytesIO(raw)) as archive:
        entries = archive.infolist()
        parts = []
        for entry in entries:
            with archive.open(entry) as file:
                parts.append(file.read(MOST_BYTES))
    kind = entries[0].compress_type if entries else zipfile.ZIP_STORED
    names = [entry.filename for entry in entries]
    return Opened(parts, lambda parts: zipped(dict(zip(names, parts, strict=True)), kind))


def _open_webp(raw: bytes) -> Opened:
    with Image.open(io.BytesIO(raw), formats=("WEBP",)) as image:
        width, height = image.size
        if width * height * 4 > MOST_BYTES:
            raise ValueError
        pixels = image.convert("RGBA").tobytes()

    def pack(parts: Sequence[bytes]) -> bytes:
        # Pixels that a change took away are zeros: an image has its size.
        whole = parts[0][: len(pixels)].ljust(len(pixels), b"\0")
        return webp(np.frombuffer(whole, np.uint8).reshape(height, width, 4))

    return Opened([pixels], pack)


def _open_spz(raw: bytes) -> Opened:
    """Open version 4: the bytes before the table, and the contents of each frame."""
    count, start = struct.unpack_from("<BI", raw, 15)
    place, parts = start + 16 * count, [raw[:start]]
    for entry in range(start, place, 16):
        size = int.from_bytes(raw[entry : entry + 8], "little")
        with zstandard.ZstdDecompressor().stream_reader(raw[place : place + size]) as frame:
            parts.append(frame.read(MOST_BYTES))
        place += size

    def pack(parts: Sequence[bytes]) -> bytes:
        frames = [zstandard.ZstdCompressor(level=1).compress(part) for part in parts[1:]]
        table = [struct.pack("<QQ", len(frame), len(part)) for frame, part in zip(frames, parts[1:], strict=True)]
        return b"".join([parts[0], *table, *frames])

    return Opened(parts, pack)


def _open_glb(raw: bytes) -> Opened:
    """Open the JSON and the binary chunk."""
    (size,) = struct.unpack_from("<I", raw, 12)
    return Opened([raw[20 : 20 + size], raw[28 + size :]], lambda parts: glb(parts[0], parts[1]))


def _open_tsplat(raw: bytes) -> Opened:
    """Open the header, and all that is behind it."""
    end = header_bytes(struct.unpack_from("<I", raw, TABLE_AT)[0])
    if end >= len(raw):
        raise ValueError
    return Opened([raw[:end], raw[end:]], lambda parts: mended(b"".join(parts)))


OPENERS: dict[bytes, Callable[[bytes], Opened]] = {
    b"\x1f\x8b": _open_gzip,
    b"PK\x03\x04": _open_zip,
    b"RIFF": _open_webp,
    b"glTF": _open_glb,
    b"NGSP\x04\0\0\0": _open_spz,
    b"TSPLAT": _open_tsplat,
}
