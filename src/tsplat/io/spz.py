"""SPZ, Niantic's packed scenes: a byte for most values, axes right, up, back where a PLY has right, down, front.

Source: the README of github.com/nianticlabs/spz and what its version 3 library reads and writes.
"""

from __future__ import annotations

import warnings
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from tsplat.errors import CorruptFileError, LoadWarning
from tsplat.io.finish import finish
from tsplat.io.options import LoadOptions
from tsplat.io.spz_decode import (
    F32,
    decode_first_three,
    decode_fixed,
    decode_half,
    decode_opacities,
    decode_scales,
    decode_sh,
    decode_smallest_three,
    half_turn,
)
from tsplat.io.spz_gzip import open_bare, open_gzip
from tsplat.io.spz_header import (
    ANTIALIASED,
    GZIP_MAGIC,
    HEADER,
    MAGIC,
    REST_COEFFICIENTS,
    Header,
    Take,
    parse_header,
)
from tsplat.io.spz_zstd import open_zstd
from tsplat.scene import Gaussians


def matches(head: bytes) -> bool:
    """Tell whether a file that begins with these bytes is an SPZ.

    The tables of a deflate block take less than half of `tsplat.io.formats.HEAD_BYTES`, so enough is there to
    unpack the first bytes; gzip around anything else is no SPZ.
    """
    if not head.startswith(GZIP_MAGIC):
        return head.startswith(MAGIC)
    try:
        return zlib.decompressobj(31).decompress(head, len(MAGIC)) == MAGIC
    except zlib.error:
        return False


def read(path: Path, options: LoadOptions, progress: Callable[[float], None]) -> Gaussians:
    """Read an SPZ of any version; see `tsplat.io.load` for the parameters.

    Raises
    ------
    LoadError
        It is of a version that is not known.
    CorruptFileError
        Header and contents contradict each other, or the file ends early.

    Warns
    -----
    LoadWarning
        The file says more than is read here, or splats were left out.
    """
    header, (means, quats, scales, opacities, sh) = unpack(path, path.read_bytes(), progress)
    if header.flags & ~ANTIALIASED:
        problem = f"flags {header.flags:#x} announce extensions, which were not read"
        warnings.warn(f"{path}: {problem}; the scene may be meant otherwise", LoadWarning, stacklevel=3)
    if options.spz_frame == "rub":
        half_turn(means, quats, sh)
    antialiased = bool(header.flags & ANTIALIASED)
    gaussians = finish(
        path, means, quats, scales, opacities, sh, max_splats=options.max_splats, antialiased=antialiased
    )
    progress(1.0)
    return gaussians


def write(file: BinaryIO, gaussians: Gaussians) -> None:
    """Write an SPZ of version 3, in the axes of the format.

    Parameters
    ----------
    file : binary file
        Open for writing.
    gaussians : Gaussians
        The scene; values become the nearest that a byte or three can hold.

    Raises
    ------
    SaveError
        A mean is too far out for 24 bits.
    """
    from tsplat.io.spz_encode import write_spz

    write_spz(file, gaussians)


def unpack(
    path: Path, raw: bytes, progress: Callable[[float], None]
) -> tuple[Header, tuple[F32, F32, F32, F32, F32]]:
    """Return the header of a whole SPZ, and means, quats, scales, opacities and sh in its own axes.

    Raises
    ------
    LoadError
        As for `read`.
    """
    header, take = open_streams(path, raw)
    streams = {}
    for number, (name, size) in enumerate(header.streams.items(), 1):
        streams[name] = take(name, size)
        progress(0.8 * number / len(header.streams))
    if header.version == 1:
        means = decode_half(streams["means"])
    else:
        means = decode_fixed(streams["means"], header.fractional_bits)
    quats = (decode_first_three if header.version < 3 else decode_smallest_three)(streams["quats"])
    scales, opacities = decode_scales(streams["scales"]), decode_opacities(streams["opacities"])
    sh = decode_sh(streams["colours"], streams["sh"], REST_COEFFICIENTS[header.sh_degree])
    return header, (means, quats, scales, opacities, sh)


def open_streams(path: Path, raw: bytes) -> tuple[Header, Take]:
    """Return the header of a whole SPZ, and what gives its streams one after the other.

    Raises
    ------
    LoadError
        As for `read`.
    """
    if raw.startswith(GZIP_MAGIC):
        return open_gzip(path, raw)
    if not raw.startswith(MAGIC):
        problem = f"begins with {raw[:4]!r}, expected {MAGIC!r} or gzip; fetch it again"
        raise CorruptFileError(path, problem, 0)
    header = parse_header(path, raw[: HEADER.size], (1, 2, 3, 4))
    return header, (open_zstd if header.version == 4 else open_bare)(path, raw, header)
