"""Gzip around a whole file, of any format but SPZ, which is gzip by itself: unpacked to disk, within limits.

Source: RFC 1952. Members one behind the other are one file, as `gzip -d` has it.
"""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path
from typing import cast

from tsplat.errors import CorruptFileError
from tsplat.io import spz
from tsplat.io.arrival import keep_room, may_be_scene
from tsplat.io.formats import HEAD_BYTES
from tsplat.io.spz_header import GZIP_MAGIC

UNPACKED = ".unpacked"
"""What is behind the name of a file that takes the place of its packed self."""

MOST_TIMES = 100
"""Scenes pack to a half or a fifth; what unpacks to so much, and `SLACK` on top, was made to fill a disk."""

SLACK = 4 << 20
PIECE_BYTES = 1 << 20


def is_packed(path: Path) -> bool:
    """Tell whether a file is gzip around something that is no SPZ."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    return head.startswith(GZIP_MAGIC) and not spz.matches(head)


def unpack(packed: Path, place: Path, progress: Callable[[float], None]) -> None:
    """Unpack a file to a place where there is none yet, or its first bytes where these are of no scene.

    Gzip inside gzip stays.

    Raises
    ------
    CorruptFileError
        It is broken, ends early, or unpacks to more than an honest file does.
    """
    from isal import igzip, isal_zlib

    broken = gzip.BadGzipFile, EOFError, cast("type[Exception]", isal_zlib.error)
    size, done, name = packed.stat().st_size, 0, place.name.removesuffix(UNPACKED)
    most = MOST_TIMES * size + SLACK
    with packed.open("rb") as raw, place.open("xb") as file, igzip.open(raw) as stream:  # type: ignore[no-untyped-call]
        while True:
            try:
                piece = stream.read(PIECE_BYTES)
            except broken as error:
                raise CorruptFileError(packed, f"does not unpack: {error}; fetch it again", raw.tell()) from error
            if not piece:
                return
            keep_room(place, done)
            if not done and len(piece) == PIECE_BYTES and not may_be_scene(piece[:HEAD_BYTES], name):
                file.write(piece)
                return  # the rest may be there to fill a disk
            done += len(piece)
            if done > most:
                problem = (
                    f"unpacks to more than {MOST_TIMES} times its {size} bytes; unpack it first if it is a scene"
                )
                raise CorruptFileError(packed, problem)
            file.write(piece)
            progress(raw.tell() / size)
