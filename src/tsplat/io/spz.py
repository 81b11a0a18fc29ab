"""SPZ, Niantic's packed scenes: a byte for most values, axes right, up, back where a PLY has right, down, front.

Source: the README of github.com/nianticlabs/spz and what its version 3 library reads and writes.
"""

from __future__ import annotations

import os
import warnings
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np

from tsplat.decode import decoders
from tsplat.errors import CorruptFileError, LoadWarning
from tsplat.io.arrays import CHUNK, Arrays, chunks
from tsplat.io.finish import finish
from tsplat.io.options import LoadOptions
from tsplat.io.spz_decode import decode
from tsplat.io.spz_gzip import BareStreams, GzipStreams
from tsplat.io.spz_header import (
    ANTIALIASED,
    GZIP_MAGIC,
    HEADER,
    MAGIC,
    REST_COEFFICIENTS,
    Header,
    Streams,
    parse_header,
)
from tsplat.io.spz_zstd import ZstdStreams
from tsplat.io.threads import on_threads
from tsplat.scene import Gaussians

UNPACKED = 0.9
"""How much of the work is done when everything is unpacked."""

ROWS = 2 * CHUNK
"""Splats unpacked and decoded at once: threads take turns at unpacking, and wait for each other at every one."""


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
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        header, streams = open_streams(path, file, size)
        arrays = Arrays.empty(header.count, 1 + REST_COEFFICIENTS[header.sh_degree])
        fill(arrays, header, streams, progress, turned=options.spz_frame == "rub")
    if header.flags & ~ANTIALIASED:
        problem = f"flags {header.flags:#x} announce extensions, which were not read"
        warnings.warn(f"{path}: {problem}; the scene may be meant otherwise", LoadWarning, stacklevel=3)
    antialiased = bool(header.flags & ANTIALIASED)
    # Halves may be nan or inf, what else is there cannot, and all quats are unit quats.
    good = None if header.version == 1 else np.ones(header.count, np.bool_)
    gaussians = finish(path, *arrays, good=good, max_splats=options.max_splats, antialiased=antialiased)
    progress(1.0)
    return gaussians


def open_streams(path: Path, file: BinaryIO, size: int) -> tuple[Header, Streams]:
    """Return the header of an SPZ and what reads its streams.

    Parameters
    ----------
    path : Path
        The file, for errors.
    file : binary file
        The SPZ and nothing else, open at its beginning.
    size : int
        Its length in bytes.

    Raises
    ------
    LoadError
        As for `read`.
    """
    head = file.read(HEADER.size)
    if head.startswith(GZIP_MAGIC):
        file.seek(0)
        packed = GzipStreams(path, file, size)
        return packed.header, packed
    if not head.startswith(MAGIC):
        problem = f"begins with {head[:4]!r}, expected {MAGIC!r} or gzip; fetch it again"
        raise CorruptFileError(path, problem, 0)
    header = parse_header(path, head, (1, 2, 3, 4))
    return header, (ZstdStreams if header.version == 4 else BareStreams)(path, file, size, header)


def fill(
    arrays: Arrays, header: Header, streams: Streams, progress: Callable[[float], None], *, turned: bool
) -> None:
    """Read an SPZ to its end.

    Parameters
    ----------
    arrays : Arrays
        Of the size that the header says; filled as `tsplat.io.finish.finish` takes them.
    header, streams : Header, Streams
        As from `open_streams`.
    progress : callable
        Called with the fraction done; what is left is for `tsplat.io.finish.finish`.
    turned : bool
        Turn the scene from the axes of the format to right, down, front.

    Raises
    ------
    CorruptFileError
        As for `read`.
    """

    def pieces() -> Iterator[tuple[str, slice, bytes]]:
        done, need = 0, header.need
        for name, whole in header.streams.items():
            width = whole // max(header.count, 1)
            for rows in chunks(header.count if width else 0, ROWS):
                piece = streams.read(name, width * (rows.stop - rows.start))
                yield name, rows, piece
                done += len(piece)
                progress(UNPACKED * done / need)
        streams.end()

    decode_with = decoders()

    def decode_piece(piece: tuple[str, slice, bytes]) -> None:
        name, rows, stream = piece
        decode(name, stream, header, turned, decode_with, arrays.part(rows))

    on_threads(decode_piece, pieces())


def write(file: BinaryIO, gaussians: Gaussians) -> list[str]:
    """Write an SPZ of version 3, in the axes of the format.

    Values become the nearest that a byte or three can hold; returns what of their range that cuts.

    Raises
    ------
    SaveError
        The bulk of the scene is too far out for 24 bits.
    """
    from tsplat.io.spz_encode import write_spz

    return write_spz(file, gaussians)
