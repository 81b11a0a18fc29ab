"""A .tsplat file: read piece by piece, or mapped into memory, to be read when it is looked at.

A map of a file that became shorter ends the process that looks at what is gone. So what reads a file whole never
maps it, and who looks at a map asks `Mapped.check_size` before.
"""

from __future__ import annotations

import mmap
import os
import weakref
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from typing import Any, NamedTuple

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


class Stamp(NamedTuple):
    """Which file it is, and when it was written last: another one where anything of it is another."""

    device: int
    inode: int
    nbytes: int
    modified: int


@dataclass(frozen=True, eq=False, slots=True, weakref_slot=True)
class Opened:
    """An open file.

    Attributes
    ----------
    path : Path
        For errors.
    header : Header
        What it says, which agrees with its size.
    file : FileIO
        Closed when this is forgotten.
    stamp : Stamp
        What it was on opening.
    """

    path: Path
    header: Header
    file: FileIO
    stamp: Stamp

    def part(self, name: str, first: int = 0, last: int | None = None) -> Array:
        """Read values of a section, by default all.

        Raises
        ------
        CorruptFileError
            The file became shorter.
        """
        dtype, length = (self.header.counts.arrays | OPTIONAL)[name]
        array = np.empty((length if last is None else min(last, length)) - first, np.dtype(dtype))
        self._fill(array.view(np.uint8), self.header.sections[name].offset + first * array.itemsize)
        return array.view(array.dtype.newbyteorder("="))

    def check(self, name: str, progress: Callable[[int], None] = lambda _: None) -> None:
        """Read a section, and compare it with its checksum; ``progress`` hears how many bytes were read.

        Raises
        ------
        CorruptFileError
            They differ, or the file became shorter.
        """
        from isal import isal_zlib

        section, checksum = self.header.sections[name], 0
        room = np.empty(min(CHECKED_BYTES, section.nbytes), np.uint8)
        for first in range(0, section.nbytes, CHECKED_BYTES):
            part = room[: section.nbytes - first]
            self._fill(part, section.offset + first)
            checksum = isal_zlib.crc32(part.data, checksum)
            progress(len(part))
        if checksum != section.checksum:
            problem = f"section {name!r} is not what its checksum says; fetch it again"
            raise CorruptFileError(self.path, problem, section.offset)

    def _fill(self, target: npt.NDArray[np.uint8], offset: int) -> None:
        self.file.seek(offset)
        while len(target):
            count = self.file.readinto(target.data)
            if not count:
                raise _shorter(self.path, self.file.tell())
            target = target[count:]


@dataclass(frozen=True, eq=False, slots=True)
class Mapped(Opened):
    """An open file in memory.

    Attributes
    ----------
    arrays : dict of str to ndarray
        Flat, by the names of their sections; read-only.
    memory : mmap
        What they lie in.
    """

    arrays: dict[str, Array]
    memory: mmap.mmap

    def check_size(self) -> None:
        """Check, in a microsecond, that all of it is still there to be looked at.

        Raises
        ------
        CorruptFileError
            The file became shorter.
        """
        if (size := os.fstat(self.file.fileno()).st_size) < len(self.memory):
            raise _shorter(self.path, size)

    def stamp_now(self) -> Stamp | None:
        """Return what is there under its name now, None where nothing is."""
        try:
            return _stamp(os.stat(self.path))
        except OSError:
            return None

    def let_go(self) -> None:
        """Hold nothing that was read so far in memory; what is looked at again is read again."""
        if hasattr(mmap, "MADV_DONTNEED"):
            self.memory.madvise(mmap.MADV_DONTNEED)


def open_file(path: Path) -> Opened:
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
    opened = Opened(path, *_opened(path))
    weakref.finalize(opened, opened.file.close)
    return opened


def open_mapped(path: Path) -> Mapped:
    """Open a file and map it; see `open_file`."""
    header, file, stamp = _opened(path)
    with ExitStack() as on_error:
        on_error.enter_context(file)
        try:
            memory = mmap.mmap(file.fileno(), stamp.nbytes, access=mmap.ACCESS_READ)
        except ValueError as error:  # it became shorter since it was opened
            raise _shorter(path, stamp.nbytes) from error
        on_error.pop_all()
    raw, arrays = np.frombuffer(memory, np.uint8), {}
    for name, section in header.sections.items():
        dtype, _ = (header.counts.arrays | OPTIONAL)[name]
        part = raw[section.offset : section.offset + section.nbytes]
        arrays[name] = part.view(np.dtype(dtype).newbyteorder("="))
    mapped = Mapped(path, header, file, stamp, arrays, memory)
    weakref.finalize(mapped, file.close)
    return mapped


def _opened(path: Path) -> tuple[Header, FileIO, Stamp]:
    with ExitStack() as on_error:
        file = on_error.enter_context(FileIO(path))
        about = os.fstat(file.fileno())
        header = parse(path, file.read(header_bytes(MOST_SECTIONS)), about.st_size)
        on_error.pop_all()
    return header, file, _stamp(about)


def _stamp(about: os.stat_result) -> Stamp:
    return Stamp(about.st_dev, about.st_ino, about.st_size, about.st_mtime_ns)


def _shorter(path: Path, offset: int) -> CorruptFileError:
    return CorruptFileError(path, "ends, but was longer when it was opened; wait until it is written", offset)
