"""JSON that lists cameras: read within limits, and told from other files."""

from __future__ import annotations

import os
from pathlib import Path

from tsplat.errors import CorruptFileError, LoadError
from tsplat.io.json_text import Kind, parse_json

MAX_BYTES = 1 << 25
"""Larger files are no camera lists; this one would be sixty thousand photographs."""


def read_json(path: Path, kind: type[Kind]) -> Kind:
    """Return the list or the object that a file of cameras holds.

    Raises
    ------
    LoadError
        It cannot be read; `CorruptFileError` where it is no JSON, or holds something else.
    """
    called = "a list of cameras" if kind is list else "an object with cameras"
    try:
        # Pipes and devices would keep a reader waiting.
        if path.exists() and not path.is_file():
            raise LoadError(path, f"is a folder or a device, expected a file with {called}; choose another")
        with path.open("rb") as file:
            # As much as is asked for would be allocated at once.
            text = file.read(min(MAX_BYTES, os.fstat(file.fileno()).st_size) + 1)
    except OSError as error:
        raise LoadError(path, f"cannot be read: {error.strerror or error}; check the path") from error
    if len(text) > MAX_BYTES:
        raise LoadError(path, f"is larger than {MAX_BYTES} bytes, too large for {called}; choose another")
    return parse_json(
        text, kind, called, lambda problem, offset: CorruptFileError(path, f"{problem}; export it again", offset)
    )
