"""JSON that lists cameras: read within limits, and told from other files."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TypeVar

from tsplat.errors import CorruptFileError, LoadError

Kind = TypeVar("Kind", list, dict)  # type: ignore[type-arg]

MAX_BYTES = 1 << 28
"""Larger files are no camera lists; this one would be half a million photographs."""


def read_json(path: Path, kind: type[Kind]) -> Kind:
    """Return the list or the object that a file of cameras holds.

    Raises
    ------
    LoadError
        It cannot be read; `CorruptFileError` where it is no JSON, or holds something else.
    """
    called = "a list of cameras" if kind is list else "an object with cameras"
    try:
        with path.open("rb") as file:
            # As much as is asked for would be allocated at once.
            text = file.read(min(MAX_BYTES, os.fstat(file.fileno()).st_size) + 1)
    except OSError as error:
        raise LoadError(path, f"cannot be read: {error.strerror or error}; check the path") from error
    if len(text) > MAX_BYTES:
        raise LoadError(path, f"is larger than {MAX_BYTES} bytes, too large for a list of cameras; choose another")
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        offset = error.pos if isinstance(error, json.JSONDecodeError) else None
        raise CorruptFileError(path, f"is not JSON, expected {called}; export it again", offset) from error
    if not isinstance(content, kind):
        raise CorruptFileError(path, f"holds a JSON {type(content).__name__}, expected {called}")
    return content
