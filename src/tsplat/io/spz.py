"""SPZ, Niantic's packed scenes: a byte for most values, axes right, up, back where a PLY has right, down, front.

Source: the README of github.com/nianticlabs/spz and what its version 3 library reads and writes.
"""

from __future__ import annotations

import os
import warnings
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO, Literal, NamedTuple

import numpy as np

from tsplat.decode import decoders
from tsplat.errors import CorruptFileError, LoadWarning
from tsplat.io.arrays import CHUNK, Arrays, chunks
from tsplat.io.finish import finish
from tsplat.io.options import LoadOptions
from tsplat.io.spz_decode import decode
from tsplat.io.spz_frames import USUAL, reframe
from tsplat.io.spz_gzip import BareStreams, GzipStreams
from tsplat.io.spz_header import (
    ANTIALIASED,
    GZIP_MAGIC,
    HEADER,
    MAGIC,
    RECORDS,
    REST_COEFFICIENTS,
    Header,
    Streams,
    parse_header,
)
from tsplat.io.spz_records import Records, parse_records
from tsplat.io.spz_zstd import ZstdStreams
from tsplat.io.threads import on_threads
from tsplat.scene import Gaussians

UNPACKED = 0.9
"""How much of the work is done when everything is unpacked."""

ROWS = 2 * CHUNK
"""Splats unpacked and decoded at once: threads take turns at unpacking, and wait for each other at every one."""

PIECE_BYTES = 1 << 16
"""Unpacked at once where nothing is made of it."""


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
        fill(arrays, header, streams, progress, turned=True)
        records = _records(header, streams)
    frame = frame_of(records, options).name
    if frame != USUAL:
        reframe(arrays, frame)
    for problem in records.problems:
        warnings.warn(f"{path}: {problem}; the scene may be meant otherwise", LoadWarning, stacklevel=3)
    antialiased = bool(header.flags & ANTIALIASED)
    # Halves may be nan or inf, what else is there cannot, and all quats are unit quats.
    good = None if header.version == 1 else np.ones(header.count, np.bool_)
    gaussians = finish(path, *arrays, good=good, max_splats=options.max_splats, antialiased=antialiased)
    progress(1.0)
    return gaussians


class Frame(NamedTuple):
    """The axes that a scene is read in, and who says so.

    Attributes
    ----------
    name : str
        One of `tsplat.io.options.SPZ_FRAMES`.
    source : {"option", "record", "format"}
        What was asked for, what the file says, or what its format says of files that do not.
    """

    name: str
    source: Literal["option", "record", "format"]


def frame_of(records: Records, options: LoadOptions) -> Frame:
    """Return the axes of an SPZ with these records."""
    if options.spz_frame:
        return Frame(options.spz_frame, "option")
    return Frame(records.frame, "record") if records.frame else Frame(USUAL, "format")


def find_frame(path: Path, options: LoadOptions) -> Frame:
    """Return the axes of an SPZ that could be loaded; one in gzip is unpacked for what stands at its end.

    Raises
    ------
    LoadError
        As for `read`.
    """
    with path.open("rb") as file:
        header, streams = open_streams(path, file, os.fstat(file.fileno()).st_size)
        if header.version < 4 and header.flags & RECORDS:
            for name, size in header.streams.items():
                for rows in chunks(size, PIECE_BYTES):
                    streams.read(name, rows.stop - rows.start)
            streams.end()
        return frame_of(_records(header, streams), options)


def _records(header: Header, streams: Streams) -> Records:
    records = parse_records(streams.records() if header.flags & RECORDS else b"")
    if more := header.flags & ~(ANTIALIASED | RECORDS):
        records.problems.append(f"flags {more:#x} are not known here, and what they announce was not read")
    return records


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
