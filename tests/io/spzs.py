"""SPZ files made value by value, and read back value by value: slow, plain, and apart from the code they test."""

from __future__ import annotations

import gzip
import math
import struct
from dataclasses import dataclass, field

import zstandard

SH_VALUES = (0, 9, 24, 45, 72)


@dataclass
class Splat:
    """One splat as the file holds it: whole numbers, except for the floats of version 1."""

    mean: tuple[float, float, float] = (0, 0, 0)
    opacity: int = 255
    colour: tuple[int, int, int] = (128, 128, 128)
    scale: tuple[int, int, int] = (100, 110, 120)
    quat: tuple[int, ...] = (0, 0, 0, 0)
    sh: list[int] = field(default_factory=list)


def streams(splats: list[Splat], version: int) -> list[bytes]:
    """Return the six streams of these splats."""
    means = b"".join(_mean(value, version) for splat in splats for value in splat.mean)
    quats = b"".join(bytes(splat.quat[:3]) if version < 3 else _smallest(splat.quat) for splat in splats)
    return [
        means,
        bytes(splat.opacity for splat in splats),
        bytes(value for splat in splats for value in splat.colour),
        bytes(value for splat in splats for value in splat.scale),
        quats,
        bytes(value for splat in splats for value in splat.sh),
    ]


def head(count: int, version: int, degree: int, bits: int = 8, flags: int = 0) -> bytes:
    """Return the first 16 bytes of a file; the last is 0."""
    return b"NGSP" + struct.pack("<IIBBBB", version, count, degree, bits, flags, 0)


def bare(splats: list[Splat], version: int, degree: int, bits: int = 8, flags: int = 0) -> bytes:
    """Return a file of version 1 to 3 before it is packed."""
    return head(len(splats), version, degree, bits, flags) + b"".join(streams(splats, version))


def zipped(raw: bytes) -> bytes:
    """Return a gzip stream with no name and no time."""
    return gzip.compress(raw, mtime=0)


def framed(splats: list[Splat], version: int, degree: int, flags: int = 0, between: bytes = b"") -> bytes:
    """Return a file of version 4, with these bytes between header and table."""
    contents = streams(splats, version)[: 6 if degree else 5]
    frames = [zstandard.ZstdCompressor().compress(content) for content in contents]
    first = head(len(splats), version, degree, flags=flags)[:15] + bytes([len(frames)])
    table = [struct.pack("<QQ", len(frame), len(content)) for frame, content in zip(frames, contents, strict=True)]
    return b"".join([first, struct.pack("<I", 32 + len(between)), bytes(12), between, *table, *frames])


def _mean(value: float, version: int) -> bytes:
    return struct.pack("<e", value) if version == 1 else int(value).to_bytes(3, "little", signed=True)


def _smallest(quat: tuple[int, ...]) -> bytes:
    largest, *others = quat
    word = largest << 30
    for shift, value in zip((20, 10, 0), others, strict=True):
        word |= (abs(value) | (512 if value < 0 else 0)) << shift
    return struct.pack("<I", word)


def unpacked(raw: bytes) -> tuple[tuple[int, ...], list[Splat]]:
    """Return version, count, degree, bits, flags and reserved of an unpacked file of version 3, and its splats."""
    magic, *fields = struct.unpack("<4sIIBBBB", raw[:16])
    _, count, degree, *_ = fields
    assert magic == b"NGSP"
    parts, start = [], 16
    for width in (9, 1, 3, 3, 4, SH_VALUES[degree]):
        parts.append([raw[start + width * index : start + width * (index + 1)] for index in range(count)])
        start += width * count
    assert start == len(raw)
    return tuple(fields), [_splat(*values) for values in zip(*parts, strict=True)]


def _splat(mean: bytes, opacity: bytes, colour: bytes, scale: bytes, quat: bytes, sh: bytes) -> Splat:
    x, y, z = (int.from_bytes(mean[start : start + 3], "little", signed=True) for start in (0, 3, 6))
    (word,) = struct.unpack("<I", quat)
    fields = [word >> shift & 1023 for shift in (20, 10, 0)]
    others = [512 - field if field > 511 else field for field in fields]
    return Splat((x, y, z), opacity[0], tuple(colour), tuple(scale), (word >> 30, *others), list(sh))


def decoded(splat: Splat, version: int, bits: int = 8) -> dict[str, list[float]]:
    """Return what a splat means, in the axes of the file."""
    if version < 3:
        x, y, z = (value / 127.5 - 1 for value in splat.quat[:3])
        quat = [math.sqrt(max(0.0, 1 - x * x - y * y - z * z)), x, y, z]
    else:
        largest, *others = splat.quat
        xyzw = [value / 511 / math.sqrt(2) for value in others]
        xyzw.insert(largest, math.sqrt(max(0.0, 1 - sum(value * value for value in xyzw))))
        quat = [xyzw[3], *xyzw[:3]]
    length = math.hypot(*quat)
    return {
        "means": [value if version == 1 else value / 2**bits for value in splat.mean],
        "quats": [value / length for value in quat],
        "scales": [math.exp(value / 16 - 10) for value in splat.scale],
        "opacities": [splat.opacity / 255],
        "sh": [(value / 255 - 0.5) / 0.15 for value in splat.colour] + [(v - 128) / 128 for v in splat.sh],
    }
