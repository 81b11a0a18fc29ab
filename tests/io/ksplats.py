"""``.ksplat`` files made field by field with `struct`, as the original viewer writes them."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tsplat.scene import Gaussians

BLOCK = 8.0
STEP = BLOCK / 2 / 32767
"""What a position is rounded to at levels 1 and 2."""

SH_RANGE = (-2.0, 1.0)


@dataclass(frozen=True)
class Part:
    """A section: its splats, cut into buckets of ``bucket_size`` and partly filled ones of ``partial``."""

    splats: Gaussians
    bucket_size: int = 4
    partial: Sequence[int] = ()

    @property
    def lengths(self) -> list[int]:
        full = (len(self.splats) - sum(self.partial)) // self.bucket_size
        return [self.bucket_size] * full + list(self.partial)


def ksplat(level: int, parts: Sequence[Part], *, room: int = 0) -> bytes:
    """Return a file whose sections have ``room`` for more splats than they hold."""
    count = sum(len(part.splats) for part in parts)
    header = bytearray(4096)
    header[1] = 1
    struct.pack_into("<4I", header, 4, len(parts), len(parts), count, count)
    struct.pack_into("<H", header, 20, level)
    struct.pack_into("<2f", header, 36, *SH_RANGE)
    heads = b"".join(_head(level, part, room) for part in parts)
    return bytes(header) + heads + b"".join(_contents(level, part, room) for part in parts)


def gaussforge(splats: Gaussians) -> bytes:
    """Return a file as GaussForge writes it: two counts empty, harmonics by channel."""
    raw = bytearray(ksplat(0, [Part(splats)]))
    struct.pack_into("<2I", raw, 8, 0, 0)
    size = (len(raw) - 5120) // len(splats)
    for index, sh in enumerate(splats.sh[:, 1:]):
        values = [float(value) for channel in range(3) for value in sh[:, channel]]
        struct.pack_into(f"<{len(values)}f", raw, 5120 + index * size + 44, *values)
    return bytes(raw)


def _head(level: int, part: Part, room: int) -> bytes:
    head = bytearray(1024)
    struct.pack_into("<2I", head, 0, len(part.splats), len(part.splats) + room)
    if level:
        full, partial = len(part.lengths) - len(part.partial), len(part.partial)
        struct.pack_into("<2IfH", head, 8, part.bucket_size, full + partial, BLOCK, 12)
        struct.pack_into("<2I", head, 32, full, partial)
    struct.pack_into("<H", head, 40, part.splats.sh_degree)
    return bytes(head)


def _contents(level: int, part: Part, room: int) -> bytes:
    centers, first = [], 0
    for length in part.lengths if level else []:
        centers.append(part.splats.means[first : first + length].mean(axis=0))
        first += length
    bucket_from_splat = [bucket for bucket, length in enumerate(part.lengths) for _ in range(length)]
    out = struct.pack(f"<{len(part.partial)}I", *part.partial) if level else b""
    out += b"".join(struct.pack("<3f", *center) for center in centers)
    rows = [
        _row(level, part.splats, i, centers[bucket_from_splat[i]] if level else None)
        for i in range(len(part.splats))
    ]
    return out + b"".join(rows) + b"\xff" * (room * len(rows[0]))


def _row(level: int, splats: Gaussians, index: int, center: np.ndarray | None) -> bytes:
    real = "e" if level else "f"
    mean = splats.means[index]
    if center is None:
        out = struct.pack("<3f", *mean)
    else:
        out = struct.pack("<3H", *(round(float(x)) + 32767 for x in (mean - center) / STEP))
    out += struct.pack(f"<3{real}4{real}", *splats.scales[index], *splats.quats[index])
    color = np.clip(0.5 + splats.sh[index, 0] / (2 * np.sqrt(np.pi)), 0, 1)
    out += bytes(round(255 * float(value)) for value in (*color, splats.opacities[index]))
    for degree in range(1, splats.sh_degree + 1):
        for channel in range(3):
            for value in splats.sh[index, degree**2 : (degree + 1) ** 2, channel]:
                out += _harmonic(level, float(value))
    return out


def _harmonic(level: int, value: float) -> bytes:
    if level < 2:
        return struct.pack("<e" if level else "<f", value)
    low, high = SH_RANGE
    return bytes([int(min(max((value - low) / (high - low), 0), 1) * 255)])
