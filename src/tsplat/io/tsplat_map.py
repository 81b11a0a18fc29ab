"""A .tsplat file mapped into memory: arrays that are read when they are looked at, however many there are."""

from __future__ import annotations

import mmap
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from tsplat.errors import CorruptFileError
from tsplat.io.tsplat_header import MAGIC, MOST_SECTIONS, OPTIONAL, Header, header_bytes, parse

Array = npt.NDArray[Any]

CHECKED_BYTES = 1 << 24
"""Bytes that go into a checksum at a time: enough to be quick, few enough to say how far it is."""


def matches(head: bytes) -> bool:
    """Tell whether a file that begins with these bytes is a .tsplat."""
    return head.startswith(MAGIC)


def is_tsplat(path: Path) -> bool:
    """Tell whether a file is a .tsplat; what cannot be read is none."""
    try:
        if not path.is_file():
            return False
        with path.open("rb") as file:
            return matches(file.read(len(MAGIC)))
    except OSError:
        return False


@dataclass(frozen=True, eq=False, slots=True)
class Mapped:
    """An open file.

    Attributes
    ----------
    path : Path
        For errors.
    header : Header
        What it says, which agrees with its size.
    arrays : dict of str to ndarray
        Flat, by the names of their sections; read-only.
    memory : mmap
        What they lie in.
    """

    path: Path
    header: Header
    arrays: dict[str, Array]
    memory: mmap.mmap

    def let_go(self) -> None:
        """Hold nothing that was read so far in memory; what is looked at again is read again."""
        if hasattr(mmap, "MADV_DONTNEED"):
            self.memory.madvise(mmap.MADV_DONTNEED)

    def check(self, name: str, progress: Callable[[int], None] = lambda _: None) -> None:
        """Read a section, and compare it with its checksum; ``progress`` hears how many bytes were read.

        Raises
        ------
        CorruptFileError
            They differ.
        """
        from isal import isal_zlib

        section, checksum = self.header.sections[name], 0
        values = self.arrays[name].view(np.uint8)
        for first in range(0, len(values), CHECKED_BYTES):
            part = values[first : first + CHECKED_BYTES]
            checksum = isal_zlib.crc32(part.data, checksum)
            progress(len(part))
        if checksum != section.checksum:
            problem = f"section {name!r} is not what its checksum says; fetch it again"
            raise CorruptFileError(self.path, problem, section.offset)


def open_mapped(path: Path) -> Mapped:
    """Open a file: its header is read and checked, nothing else.

    Raises
    ------
    LoadError
        It is of another version.
    CorruptFileError
        It ends early, or what it says contradicts itself.
    OSError
        It cannot be read.
    """
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        header = parse(path, file.read(header_bytes(MOST_SECTIONS)), size)
        memory = _mapped(path, file, size)
    raw, arrays = np.frombuffer(memory, np.uint8), {}
    for name, section in header.sections.items():
        dtype, _ = (header.counts.arrays | OPTIONAL)[name]
        part = raw[section.offset : section.offset + section.nbytes]
        arrays[name] = part.view(np.dtype(dtype).newbyteorder("="))
    return Mapped(path, header, arrays, memory)


def _mapped(path: Path, file: BinaryIO, size: int) -> mmap.mmap:
    try:
        return mmap.mmap(file.fileno(), size, access=mmap.ACCESS_READ)
    except ValueError as error:  # it became shorter since it was opened
        raise CorruptFileError(path, f"no longer has {size} bytes; wait until it is written", size) from error
