"""Where machine code is kept between runs, under a name that changes whenever the code could.

The folder is named after everything that can change the machine code: this package, Numba and its settings. So
it is never stale, and it lies in the user's cache, so a read-only installation compiles once as well.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import re
import shutil
import time
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from types import CodeType
from typing import Any

import platformdirs

from tsplat._machine_code import MachineCode, from_bytes, processor, to_bytes
from tsplat.errors import SaveError
from tsplat.files import replacing
from tsplat.own_files import is_private, make_private, read_own

NOT_COMPILED = frozenset(
    {"bench", "cache", "convert", "doctor", "info", "io", "optimize", "record", "terminal", "viewer"}
    | {"arguments.py", "cli.py", "drawing.py", "export.py", "first_view.py", "kept.py", "options.py"}
    | {"progress.py", "standard_streams.py", "temporary.py", "warmup.py", "warmup_process.py"}
)
"""What no kernel can see, because the layers forbid it: editing these compiles nothing again."""

KEPT_SECONDS = 30 * 24 * 3600.0
"""How long the machine code of another version stays; it is compiled again if that comes back."""

LARGEST = 1 << 26
"""Bytes of machine code that are read; `draw` takes a quarter of a megabyte."""

PACKAGE = Path(__file__).parent


def place(function: Callable[..., Any], types: str) -> Path | None:
    """Return the file for a kernel's machine code for some types, or None where no such file can be written.

    Parameters
    ----------
    function : callable
        The kernel as Python.
    types : str
        Of its arguments, see `tsplat._arguments.described`.
    """
    folder = cache_folder()
    if folder is None:
        return None
    file = Path(function.__code__.co_filename)
    digest = hashlib.sha256(_text_of(function.__code__).encode())
    digest.update(f"{function.__module__} {types} {processor()}".encode())
    if not file.is_relative_to(PACKAGE):  # the folder's name does not know what else is in that file
        with suppress(OSError):
            digest.update(file.read_bytes())
    name = re.sub(r"\W", "", function.__name__)
    return folder / f"{name}-{digest.hexdigest()[:24]}"


def _text_of(code: CodeType) -> str:
    """Return what tells a function's code from any other; `marshal` also tells how often its parts are in use."""
    constants = [_text_of(each) if isinstance(each, CodeType) else repr(each) for each in code.co_consts]
    return f"{code.co_code.hex()} {code.co_names} {code.co_varnames} {code.co_freevars} {constants}"


def kept(file: Path | None) -> MachineCode | None:
    """Return the machine code in a file; None where there is none, or not all of it, or somebody else's."""
    with suppress(OSError):
        content = read_own(file, LARGEST) if file else None
        return from_bytes(content, file.name) if file and content else None
    return None


def keep(file: Path | None, code: MachineCode) -> None:
    """Write machine code to a file, where that is possible."""
    with suppress(SaveError):
        if file:
            with replacing(file, private=True) as out:
                out.write(to_bytes(code, file.name))


@lru_cache(maxsize=1)
def cache_folder() -> Path | None:
    """Return the folder for machine code, or None where this user cannot write to one, or others can.

    Whoever could write to it could have this process run anything.
    """
    chosen = os.environ.get("NUMBA_CACHE_DIR") or platformdirs.user_cache_dir("tsplat")
    folder = Path(os.path.realpath(chosen)) / f"kernels-{source_digest(PACKAGE)}"
    try:
        is_new = not folder.is_dir()
        make_private(folder)
        if is_new:
            _remove_old(folder.parent)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK) and is_private(folder) else None


def _remove_old(parent: Path) -> None:
    """Remove the folders of versions for which nothing was compiled in a long time."""
    for folder in parent.glob("kernels-*"):
        if is_private(folder) and time.time() - folder.stat().st_mtime > KEPT_SECONDS:
            shutil.rmtree(folder, ignore_errors=True)


def source_digest(package: Path) -> str:
    """Return a name for all that decides the machine code besides the processor."""
    digest = hashlib.sha256(" ".join(_compilers()).encode())
    for entry in sorted(package.iterdir()):
        if entry.name in NOT_COMPILED:
            continue
        for path in sorted(entry.rglob("*.py")) if entry.is_dir() else [entry]:
            if path.suffix == ".py":
                digest.update(f"\n{path.relative_to(package).as_posix()}\n".encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _compilers() -> list[str]:
    """Return what tells this Numba and LLVM from others: versions from the names of folders, and settings."""
    found = {name: importlib.util.find_spec(name) for name in ("numba", "llvmlite")}
    versions = [
        folder.name
        for name, spec in found.items()
        if spec is not None and spec.origin is not None
        for folder in sorted(Path(spec.origin).parents[1].glob(f"{name}-*"))
    ]
    settings = [f"{name}={value}" for name, value in sorted(os.environ.items()) if name.startswith("NUMBA_")]
    return versions + [each for each in settings if not each.startswith("NUMBA_CACHE_DIR=")]
