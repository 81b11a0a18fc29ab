"""Files that are whole or not there at all."""

from __future__ import annotations

import atexit
import errno
import os
import re
import secrets
import signal
import stat
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from tsplat._leftovers import clear, hold
from tsplat.errors import SaveError, TsplatError

_PART = re.compile(r"\..*\.[0-9a-f]{16}\.part", re.DOTALL)
"""A name that nobody else gives, as what is left under it is removed."""

_NAME_CHARS = 50
"""Characters of a name that its unfinished file bears: file systems take 255 bytes."""

_unfinished: set[Path] = set()
"""What a daemon thread may still be writing when the process ends."""


@atexit.register
def _remove_unfinished() -> None:
    for beside in tuple(_unfinished):
        with suppress(OSError):
            beside.unlink(missing_ok=True)


if hasattr(os, "register_at_fork"):  # a child that ends takes nothing of its parent's along
    os.register_at_fork(after_in_child=_unfinished.clear)


@contextmanager
def replacing(path: Path, *, private: bool = False) -> Iterator[BinaryIO]:
    """Open a file beside ``path`` that takes its place, in one step, when all went well.

    A file that was there gives its mode, and its owner where that is allowed; a link stays, what it leads to is
    replaced. What ended processes left unfinished in the folder is removed.

    Parameters
    ----------
    path : Path
        A file, or nothing yet.
    private : bool
        Whether a new file is for nobody else to read, and a link is replaced.

    Raises
    ------
    SaveError
        It cannot be written, which is tried before anything else is done; nothing is left behind.
    """
    try:
        target = path if private else _led_to(path)
        before = None if private else _before(target)
        clear(target.parent, _PART)
        beside, file = _new_part(target, 0o600 if private or before else 0o666)
        try:
            with file:
                yield file
                file.flush()
                _make_like(file.fileno(), before)
                if os.name != "nt":
                    beside.replace(target)  # while it is held: others would take it for left behind
            if os.name == "nt":
                beside.replace(target)
        except BaseException:
            beside.unlink(missing_ok=True)
            _unfinished.discard(beside)
            raise
        _unfinished.discard(beside)
    except TsplatError:
        raise  # what went wrong was not the writing
    except OSError as error:
        raise SaveError(f"{path}: cannot be written: {error.strerror or error}; choose another folder") from error


def _led_to(path: Path) -> Path:
    """Return what a link leads to, and any other path as it is."""
    if not path.is_symlink():
        return path
    # Into a folder like /tmp anyone may put a link that leads to what is ours.
    if hasattr(os, "geteuid") and path.lstat().st_uid not in (os.geteuid(), 0, path.parent.stat().st_uid):
        raise PermissionError(errno.EPERM, "it is a link that somebody else made")
    return Path(os.path.realpath(path))


def _before(target: Path) -> os.stat_result | None:
    """Return what there is of a file that is going to be replaced."""
    try:
        about = target.lstat()
    except FileNotFoundError:
        return None
    if stat.S_ISDIR(about.st_mode):
        raise IsADirectoryError(errno.EISDIR, "it is a folder")
    if not stat.S_ISREG(about.st_mode):
        raise OSError(errno.EINVAL, "it is a device, a pipe or a link to itself, not a file")
    return about


def _new_part(target: Path, mode: int) -> tuple[Path, BinaryIO]:
    """Return a new file beside a target, held by this process."""
    while True:
        beside = target.with_name(f".{target.name[:_NAME_CHARS]}.{secrets.token_hex(8)}.part")
        _unfinished.add(beside)
        try:
            file = _opened(beside, mode)
        except BaseException:
            _unfinished.discard(beside)
            raise
        if hold(file.fileno(), beside):
            return beside, file
        file.close()
        _unfinished.discard(beside)


def _opened(beside: Path, mode: int) -> BinaryIO:
    return open(beside, "xb", opener=lambda path, flags: os.open(path, flags, mode))


def _make_like(descriptor: int, before: os.stat_result | None) -> None:
    """Give a file the mode of the one that it replaces, and its owner where this user may."""
    if before is None or not hasattr(os, "fchown"):
        return
    mode, about = stat.S_IMODE(before.st_mode) & 0o777, os.fstat(descriptor)
    try:
        if (about.st_uid, about.st_gid) != (before.st_uid, before.st_gid):
            os.fchown(descriptor, before.st_uid, before.st_gid)
    except OSError:
        try:
            os.fchown(descriptor, -1, before.st_gid)
        except OSError:
            mode &= 0o707  # what the group may was said of another group
    with suppress(OSError):  # file systems without modes
        os.fchmod(descriptor, mode)


@contextmanager
def tidy_end() -> Iterator[None]:
    """Let SIGTERM and SIGHUP end this process as an error does, so that no unfinished or temporary file stays."""

    def leave(number: int, _: object) -> None:
        for each in deadly:  # shells and systems send several; the first one is being followed
            signal.signal(each, signal.SIG_IGN)
        sys.exit(128 + number)

    numbers = signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)
    heard = threading.current_thread() is threading.main_thread()
    deadly = [number for number in numbers if heard and signal.getsignal(number) is signal.SIG_DFL]
    for number in deadly:
        signal.signal(number, leave)
    try:
        yield
    finally:
        for number in deadly:
            signal.signal(number, signal.SIG_DFL)
