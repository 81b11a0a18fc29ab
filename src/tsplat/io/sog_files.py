"""Where the files of a SOG scene come from: a zip archive, or the folder of its meta.json.

Both read whole files of limited size, and nothing outside themselves whatever a name says.
"""

from __future__ import annotations

import os
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from types import TracebackType
from typing import IO, BinaryIO, Protocol, Self

from tsplat.errors import CorruptFileError, shown

ZIP_MAGICS = (b"PK\x03\x04", b"PK\x05\x06")
"""A zip that holds files, and an empty one."""

NAME_CHARS = 200
"""Longer names are no file names; they would only fill a message."""


class Files(Protocol):
    """What the rest of the reader sees of an archive or a folder."""

    def size(self, name: str) -> int:
        """Return how many bytes the file takes, at most as many as are really there."""

    def read(self, name: str, limit: int) -> bytes:
        """Return the first ``limit`` bytes of the file, or all."""

    def corrupt(self, name: str, problem: str) -> CorruptFileError:
        """Return the error that says what is wrong with the file."""


class Folder:
    """Files beside a meta.json."""

    def __init__(self, meta: Path) -> None:
        self.path = meta.parent

    def size(self, name: str) -> int:
        return self._find(name).stat().st_size

    def read(self, name: str, limit: int) -> bytes:
        with self._find(name).open("rb") as file:
            # As much as is asked for would be allocated at once.
            return file.read(min(limit, os.fstat(file.fileno()).st_size))

    def corrupt(self, name: str, problem: str) -> CorruptFileError:
        return CorruptFileError(self.path / name, f"{problem}; fetch it again")

    def _find(self, name: str) -> Path:
        path = self.path / name
        # Pipes and devices would keep a reader waiting.
        if not path.is_file():
            raise self.corrupt(name, "is missing, expected a file of the scene")
        return path


class Archive:
    """Files in a zip, stored or deflated.

    Raises
    ------
    CorruptFileError
        It is no whole zip.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file: BinaryIO = path.open("rb")
        try:
            self._zip = zipfile.ZipFile(self._file)
        except (zipfile.BadZipFile, NotImplementedError, ValueError, EOFError) as error:
            self._file.close()
            problem = "the zip's directory cannot be read, expected a whole zip archive; fetch it again"
            raise CorruptFileError(path, problem) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._zip.close()
        self._file.close()

    def names(self) -> list[str]:
        """Return the names of all files."""
        return list(self._zip.NameToInfo)

    def size(self, name: str) -> int:
        entry = self._find(name)
        # Zeros cost nothing in a zip, and its directory may say anything.
        return min(entry.file_size, entry.compress_size, self.path.stat().st_size)

    def read(self, name: str, limit: int) -> bytes:
        entry = self._find(name)
        with self.open(name) as file:
            content = file.read(limit)
        if len(content) < min(limit, entry.file_size):
            raise self.corrupt(name, f"holds {len(content)} bytes, expected {entry.file_size}")
        return content

    @contextmanager
    def open(self, name: str) -> Iterator[IO[bytes]]:
        """Give the file to be read from its beginning.

        Raises
        ------
        CorruptFileError
            It is missing or cannot be unpacked, then or while it is read.
        """
        entry = self._find(name)
        if entry.compress_size > (there := self.path.stat().st_size):
            raise self.corrupt(
                name, f"takes {entry.compress_size} bytes by the zip's directory, {there} are there"
            )
        try:
            with self._zip.open(entry) as file:
                yield file
        except CorruptFileError:
            raise
        except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError, ValueError) as error:
            raise self.corrupt(name, "cannot be unpacked, expected contents that fit their checksum") from error

    def corrupt(self, name: str, problem: str) -> CorruptFileError:
        entry = self._zip.NameToInfo.get(name)
        offset = entry.header_offset if entry else None
        return CorruptFileError(self.path, f"{shown(name, NAME_CHARS)} {problem}; fetch it again", offset)

    def _find(self, name: str) -> zipfile.ZipInfo:
        entry = self._zip.NameToInfo.get(name)
        if entry is None:
            raise self.corrupt(name, "is missing from the zip, expected a file of the scene")
        if entry.header_offset < 0:
            raise self.corrupt(
                name, f"begins at byte {entry.header_offset} by the zip's directory, expected 0 or more"
            )
        if entry.flag_bits & 1 or entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise self.corrupt(name, "is encrypted or packed in a rare way, expected stored or deflated")
        return entry


def is_inside(name: object) -> bool:
    """Tell whether a name from a file is one that stays inside its folder on every system."""
    if not isinstance(name, str) or not name or len(name) > NAME_CHARS:
        return False
    if any(c in '\\:*?"<>|' or not c.isprintable() for c in name):
        return False
    path = PurePosixPath(name)
    return not path.is_absolute() and ".." not in path.parts and bool(path.name)
