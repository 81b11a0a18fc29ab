"""A .tsplat of a few splats, as small as readers allow: sections follow each other without pages of nothing."""

from __future__ import annotations

import math
import struct
import zlib

import numpy as np

from tests.scenes import random_gaussians
from tsplat.io.tsplat_header import (
    HEADER,
    LEAST_ALIGNMENT,
    MOST_SECTIONS,
    SECTION,
    Counts,
    Header,
    Section,
    header_bytes,
    packed,
)

TABLE_AT, CHECKSUM_AT = 44, HEADER.size - 4


def small(splats: int = 5, coefficients: int = 3) -> bytes:
    """Return a whole file of one block."""
    counts = Counts(splats, 1, coefficients, splats)
    cloud = random_gaussians(np.random.default_rng(7), splats, 0)
    some = {"quats": cloud.quats, "scales": cloud.scales, "opacities": cloud.opacities, "means": cloud.means}
    some |= {f"sample_{name}": array for name, array in some.items()} | {"sh_first": cloud.sh}
    sections, body, start = {}, b"", header_bytes(len(counts.arrays))
    for name, (dtype, length) in counts.arrays.items():
        values = np.zeros(length, dtype)
        if name in some and name != "means":
            values[:] = some[name].reshape(-1)
        at = math.ceil((start + len(body)) / LEAST_ALIGNMENT) * LEAST_ALIGNMENT
        body = body.ljust(at - start, b"\0") + values.tobytes()
        sections[name] = Section(at, values.nbytes, zlib.crc32(values.tobytes()))
    return packed(Header(counts, False, sections)) + body


def mended(raw: bytes) -> bytes:
    """Return a file whose checksums fit what is in it, wherever it says that they are."""
    whole = bytearray(raw)
    if len(whole) < HEADER.size:
        return raw
    end = header_bytes(min(struct.unpack_from("<I", whole, TABLE_AT)[0], MOST_SECTIONS))
    if len(whole) < end:
        return raw
    for entry in range(HEADER.size, end, SECTION.size):
        offset, nbytes = struct.unpack_from("<QQ", whole, entry + 16)
        if offset + nbytes <= len(whole):
            struct.pack_into("<I", whole, entry + 32, zlib.crc32(whole[offset : offset + nbytes]))
    without = whole[:CHECKSUM_AT] + bytes(4) + whole[HEADER.size : end]
    struct.pack_into("<I", whole, CHECKSUM_AT, zlib.crc32(without))
    return bytes(whole)
