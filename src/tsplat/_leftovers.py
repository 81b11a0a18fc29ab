"""What an ended process left where the next one finds it: told from what is in use, and removed.

Whoever makes such a file or folder holds a lock on it (flock). The system lets go of that however the process
ends, in whatever container it ran, so that what can be locked belongs to nobody any more.
"""

from __future__ import annotations

import os
import re
import secrets
import stat
from contextlib import suppress
from pathlib import Path
from types import ModuleType

fcntl: ModuleType | None
try:
    import fcntl
except ImportError:  # Windows, where nothing is looked for
    fcntl = None

_OPEN = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0)

_OWNER = re.compile(r"tsplat-[0-9a-f]{12}\.owner")


def hold(descriptor: int, path: Path) -> bool:
    """Lock what was just made, until its descriptor is closed; return False where it was taken for left behind."""
    return _locked(descriptor) is not False and _leads_to(path, descriptor)


def clear(folder: Path, names: re.Pattern[str]) -> None:
    """Remove those files and folders of such names in a folder that ended processes of this user left."""
    if fcntl is None:
        return
    with suppress(OSError), os.scandir(folder) as entries:
        for name in [entry.name for entry in entries if names.fullmatch(entry.name)]:
            with suppress(OSError):
                _remove_if_left(folder / name)


class Owner:
    """Names for files that other programs fetch from a folder; held by an empty file, as long as there may be any.

    Parameters
    ----------
    folder : Path
        What ended processes left under such names in it is removed now. Where it does not exist, there is only a
        name: shared memory is no folder on some systems.

    Attributes
    ----------
    name : str
        What the names of the files begin with; ``-`` follows.
    """

    def __init__(self, folder: Path) -> None:
        self._descriptor: int | None = None
        clear(folder, _OWNER)
        while True:
            self.name = f"tsplat-{secrets.token_hex(6)}"
            self._path = folder / f"{self.name}.owner"
            if not folder.is_dir():
                return
            self._descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
            if hold(self._descriptor, self._path):
                return
            os.close(self._descriptor)

    def close(self) -> None:
        """Remove the empty file, once those of its name are gone."""
        if self._descriptor is not None:
            with suppress(OSError):
                self._path.unlink(missing_ok=True)
            os.close(self._descriptor)


def _locked(descriptor: int) -> bool | None:
    """Lock it if nobody has; return None where there are no locks."""
    if fcntl is None:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # some file systems of networks
        return None
    return True


def _leads_to(path: Path, descriptor: int) -> bool:
    """Tell whether a path still names what is open; it may have been removed before it was locked."""
    try:
        return os.name == "nt" or os.path.samestat(path.lstat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _remove_if_left(path: Path) -> None:
    descriptor = os.open(path, _OPEN)
    try:
        about = os.fstat(descriptor)
        known = stat.S_ISREG(about.st_mode) or stat.S_ISDIR(about.st_mode)
        if known and about.st_uid == os.geteuid() and _locked(descriptor) and _leads_to(path, descriptor):
            _remove(path, about)
    finally:
        os.close(descriptor)


def _remove(path: Path, about: os.stat_result) -> None:
    if stat.S_ISDIR(about.st_mode):
        import shutil  # 4 ms that hardly anyone has to pay

        shutil.rmtree(path, ignore_errors=True)
        return
    if _OWNER.fullmatch(path.name):
        for other in path.parent.glob(f"{path.stem}-*"):
            with suppress(OSError):
                other.unlink()
    path.unlink()
