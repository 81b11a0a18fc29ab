"""What took long to make and is kept for the next time: files in the user's cache, within a bound.

Where there is no such folder, or no room on its disk, nothing is kept, and nobody is bothered.
"""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, NamedTuple

import platformdirs

from tsplat.errors import OptionError, SaveError
from tsplat.files import replacing
from tsplat.numerals import finite
from tsplat.own_files import is_own_file, is_private, make_private

SIZE_VARIABLE = "TSPLAT_CACHE_GB"
"""Environment variable: gigabytes that may be kept; 0 keeps nothing."""

LARGEST = 8 * 10**9
"""Bytes kept at most where nobody says how many."""

FREE_SHARE = 0.2
"""Nor is more kept than this share of what would be free on the disk if nothing were kept."""

SUFFIX, UNFINISHED = ".tsplat", ".part"

ABANDONED_SECONDS = 3600.0
"""A file that nobody has added to for so long is left of a process that was ended."""


class Entry(NamedTuple):
    """A file that is kept, how large it is, and when it was used last, in seconds of the clock."""

    path: Path
    nbytes: int
    used: float


def folder() -> Path:
    """Return where hierarchies are kept; it need not exist."""
    return Path(os.path.realpath(platformdirs.user_cache_dir("tsplat"))) / "hierarchies"


def bound() -> int:
    """Return how many bytes may be kept.

    Raises
    ------
    OptionError
        ``TSPLAT_CACHE_GB`` is no number of gigabytes.
    """
    if text := os.environ.get(SIZE_VARIABLE, ""):
        gigabytes = finite(text)
        if gigabytes is not None and 0.0 <= gigabytes < 1e9:
            return round(1e9 * gigabytes)
        raise OptionError(f"{SIZE_VARIABLE} must be gigabytes, 0 or more, got {text!r}")
    with suppress(OSError):
        place = folder()
        there = next(parent for parent in (place, *place.parents) if parent.exists())
        free = shutil.disk_usage(there).free + sum(entry.nbytes for entry in entries())
        return min(LARGEST, round(FREE_SHARE * free))
    return 0


def entries() -> list[Entry]:
    """Return what is kept, the least recently used first."""
    return sorted(_files(SUFFIX), key=lambda entry: entry.used)


def recalled(name: str) -> Path | None:
    """Return the file that is kept under a name, or None; it counts as used now.

    None, too, where others could have written it: no scene is drawn with what a stranger left.
    """
    path = folder() / f"{name}{SUFFIX}"
    with suppress(OSError):
        if is_own_file(path.lstat()) and is_private(folder()):
            os.utime(path)
            return path
    return None


def keep(name: str, nbytes: int, write: Callable[[BinaryIO], None]) -> bool:
    """Keep what ``write`` writes under a name; return whether that was possible.

    What was not used for longest makes room for so many bytes.
    """
    with suppress(SaveError, OSError, OptionError):
        if _make_room(nbytes):
            place = folder()
            make_private(place)
            if is_private(place):
                with replacing(place / f"{name}{SUFFIX}", private=True) as file:
                    write(file)
                return True
    return False


def forget(entry: Entry) -> bool:
    """Remove what is kept; return whether that was possible."""
    try:
        entry.path.unlink(missing_ok=True)
    except OSError:
        return False
    return True


def clear() -> list[Entry]:
    """Remove all that is kept, unfinished files too; return what was removed."""
    return [entry for entry in [*entries(), *_files(UNFINISHED)] if forget(entry)]


def _make_room(nbytes: int) -> bool:
    """Remove what has to go for so many bytes; return whether there is room then."""
    now, most = time.time(), bound()
    for entry in _files(UNFINISHED):
        if now - entry.used > ABANDONED_SECONDS:
            forget(entry)
    if nbytes > most:
        return False
    kept = entries()
    held = sum(entry.nbytes for entry in kept)
    for entry in kept:
        if held + nbytes > most and forget(entry):
            held -= entry.nbytes
    return held + nbytes <= most


def _files(suffix: str) -> list[Entry]:
    found = []
    with suppress(OSError):
        for path in folder().glob(f"*{suffix}"):
            with suppress(OSError):
                about = path.lstat()
                if is_own_file(about):
                    found.append(Entry(path, about.st_size, about.st_mtime))
    return found
