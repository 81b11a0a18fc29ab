"""Folders that nobody but this user can write to, and files that this user wrote: what may be run from there."""

from __future__ import annotations

import os
import stat
from pathlib import Path

_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH

_OPEN = (
    os.O_RDONLY
    | getattr(os, "O_NOFOLLOW", 0)  # a link leads where anybody may write
    | getattr(os, "O_NONBLOCK", 0)  # a pipe would keep us waiting for its writer
    | getattr(os, "O_CLOEXEC", 0)
    | getattr(os, "O_BINARY", 0)
)


def make_private(folder: Path) -> None:
    """Make a folder, and those above it that are missing, for nobody else; an own one that others read, too.

    Raises
    ------
    OSError
        It cannot be made.
    """
    for each in (*reversed(folder.parents), folder):
        if not each.exists():
            each.mkdir(0o700, exist_ok=True)
    about = folder.lstat()
    if os.name != "nt" and about.st_uid == os.geteuid() and not about.st_mode & _OTHERS_WRITE:
        folder.chmod(0o700)


def is_private(folder: Path) -> bool:
    """Tell whether nobody but this user and the system's can write to a folder, nor put another in its place.

    Parameters
    ----------
    folder : Path
        As `os.path.realpath` has it: a link on the way there may be changed meanwhile.
    """
    if os.name == "nt":  # where each user's folders are their own
        return True
    try:
        child, *above = (each.lstat() for each in (folder, *folder.parents))
    except OSError:
        return False
    if not stat.S_ISDIR(child.st_mode) or child.st_uid != os.geteuid() or child.st_mode & _OTHERS_WRITE:
        return False
    trusted = os.geteuid(), 0, above[-1].st_uid if above else 0  # who owns / may do anything
    for parent in above:
        # In a sticky folder, as /tmp is, others can neither remove nor rename what is not theirs.
        open_to_others = parent.st_mode & _OTHERS_WRITE and not parent.st_mode & stat.S_ISVTX
        if parent.st_uid not in trusted or child.st_uid not in trusted or open_to_others:
            return False
        child = parent
    return True


def is_own_file(about: os.stat_result) -> bool:
    """Tell whether it is a file, no link, device or pipe, that this user alone can write to."""
    if not stat.S_ISREG(about.st_mode):
        return False
    return os.name == "nt" or (about.st_uid == os.geteuid() and not about.st_mode & _OTHERS_WRITE)


def read_own(path: Path, most: int) -> bytes | None:
    """Return what is in a file of this user's; None where it is anything else, or has more bytes than ``most``.

    Raises
    ------
    OSError
        It cannot be read.
    """
    with open(os.open(path, _OPEN), "rb") as file:
        about = os.fstat(file.fileno())
        if not is_own_file(about) or about.st_size > most:
            return None
        return file.read(most)
