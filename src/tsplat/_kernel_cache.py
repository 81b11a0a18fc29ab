"""Where machine code is kept between runs, under a name that changes whenever the code could.

Numba notices an edit only in the file of the kernel itself, not in the helpers it calls nor in the
constants it imports. Here the folder is named after everything that can change the machine code, so
it is never stale, and it lies in the user's cache, so a read-only installation compiles once as well.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import numba
import platformdirs
from numba.core.caching import FunctionCache
from numba.core.runtime.nrt import rtsys

_config: Any = numba.config

NOT_COMPILED = frozenset(
    {"bench", "cache", "convert", "doctor", "info", "io", "optimize", "record", "terminal", "viewer"}
    | {"arguments.py", "cli.py", "drawing.py", "export.py", "kept.py", "options.py", "progress.py"}
)
"""What no kernel can see, because the layers forbid it: editing these compiles nothing again."""


class LoadingCache(FunctionCache):
    """Numba's cache, but loading does without what only compiling needs.

    Numba first registers every function it knows, for a quarter of a second; the compiler does so
    itself when it comes to that.
    """

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled function of this signature, or None."""
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)


def keep_compiled(dispatcher: Any, function: Callable[..., Any]) -> None:
    """Let a dispatcher load its machine code from the cache folder and keep it there, where there is one."""
    folder = cache_folder()
    if folder is None:
        return
    with _numba_cache_dir(folder):
        dispatcher._cache = LoadingCache(function)


@lru_cache(maxsize=1)
def cache_folder() -> Path | None:
    """Return the folder for machine code, or None where no such folder can be written."""
    chosen = os.environ.get("NUMBA_CACHE_DIR") or platformdirs.user_cache_dir("tsplat")
    folder = Path(chosen) / f"kernels-{source_digest(Path(__file__).parent)}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK) else None


def source_digest(package: Path) -> str:
    """Return a name for all that decides the machine code besides Python and the processor, which Numba checks."""
    digest = hashlib.sha256(f"{numba.__version__} {_config.BOUNDSCHECK} {_config.OPT}".encode())
    for entry in sorted(package.iterdir()):
        if entry.name in NOT_COMPILED:
            continue
        for path in sorted(entry.rglob("*.py")) if entry.is_dir() else [entry]:
            if path.suffix == ".py":
                digest.update(f"\n{path.relative_to(package).as_posix()}\n".encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


@contextmanager
def _numba_cache_dir(folder: Path) -> Iterator[None]:
    # Numba asks for its cache folder once, when the cache is made; other users of Numba keep theirs.
    before = _config.CACHE_DIR
    _config.CACHE_DIR = str(folder)
    try:
        yield
    finally:
        _config.CACHE_DIR = before
