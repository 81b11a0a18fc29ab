"""A scene that comes from elsewhere, looked at while it comes: whether it may be one, and whether there is room.

What is no scene by its first bytes is not brought here to the end; its reader says what is wrong with these.
"""

from __future__ import annotations

import errno
import os
import shutil
import time
from pathlib import Path

from tsplat.errors import LoadError
from tsplat.io.formats import FORMATS, HEAD_BYTES
from tsplat.io.sog_files import ZIP_MAGICS
from tsplat.io.splat import may_be_splat
from tsplat.io.spz_header import GZIP_MAGIC

UNMARKED = ".splat", ".ksplat"
"""Suffixes of formats that begin with any bytes."""

OTHER_MAGICS = (GZIP_MAGIC, *ZIP_MAGICS, b"RIFF", b"\x89PNG")
"""What the files of a scene may begin with beside the scene itself."""

SPARE_BYTES, SPARE_SHARE = 1 << 28, 0.02
"""Of the disk, what is left for others: the smaller of both, and no more than what came already."""

SLOW_SECONDS, SLOW_BYTES = 60.0, 1 << 14
"""A server that sends less in this time is given up: no link is so slow."""


def may_be_scene(head: bytes, name: str) -> bool:
    """Tell whether a file of a scene may begin like this; where it may not, every reader refuses it for that."""
    known = head.startswith(OTHER_MAGICS) or name.lower().endswith(UNMARKED)
    return known or any(each.matches(head) for each in FORMATS) or may_be_splat(head)


def keep_room(place: Path, done: int, more: int = 0) -> None:
    """Raise the error of a full disk before it is full, or would be when ``more`` bytes follow those that came."""
    usage = shutil.disk_usage(place.parent)
    if usage.free < more + min(SPARE_BYTES, int(SPARE_SHARE * usage.total), done):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


class Watch:
    """Looks at a download from time to time.

    Parameters
    ----------
    place : Path
        The file that grows.
    """

    def __init__(self, place: Path) -> None:
        self._place, self._known = place, False
        self._since, self._done = time.monotonic(), 0

    def goes_on(self, done: int, size: int | None) -> bool:
        """Tell whether the rest is wanted, when so many bytes have come, of so many where that is known.

        Raises
        ------
        LoadError
            It comes too slowly.
        OSError
            There is no room for it.
        """
        now = time.monotonic()
        if done - self._done >= SLOW_BYTES:
            self._since, self._done = now, done
        elif now - self._since > SLOW_SECONDS:
            problem = f"comes too slowly, less than {SLOW_BYTES} bytes in {SLOW_SECONDS:.0f} s; try again"
            raise LoadError(self._place, problem)
        if done:
            keep_room(self._place, done, max(0, (size or 0) - done))
        return self._known or done < HEAD_BYTES or self._is_known()

    def _is_known(self) -> bool:
        head = _head(self._place)
        self._known = len(head) == HEAD_BYTES and may_be_scene(head, self._place.name)
        return self._known or len(head) < HEAD_BYTES  # what came may not be written yet


def _head(place: Path) -> bytes:
    with place.open("rb") as file:
        return file.read(HEAD_BYTES)
