"""What a PLY's comments say about its scene: how it was trained, and which way is up.

Brush writes ``SplatRenderMode: default``, ``mip`` or ``2dgs``; Postshot writes ``antialiased 0`` or ``1``.
Source: the README of PlayCanvas' splat-transform, which reads both. nerfstudio writes ``Vertical Axis: z``;
people write ``Z-up``, ``up_axis = +Y``, ``up: 0 0 1``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable

import numpy as np

from tsplat.scene import Gaussians, Vector

MODE = "SplatRenderMode:"
FLAG = "antialiased"

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?"
_KIND = r"(?:axis|direction|dir|vector|vec)"
_NAMED = rf"(?:(?:vertical|up)[ _-]?{_KIND}|{_KIND}[ _-]?up)\s*(?:is\b|[:=])?"
_BARE = r"(?:vertical|up)\s*(?:is\b|[:=])"
_UP = rf"(?<![a-z])(?:{_NAMED}|{_BARE})\s*['\"\[(]?\s*"
_SEPARATOR = r"\s*[,;\s]\s*"

_AXIS = re.compile(rf"{_UP}([-+]?)([xyz])(?![a-z0-9])")
_VECTOR = re.compile(rf"{_UP}({_NUMBER}){_SEPARATOR}({_NUMBER}){_SEPARATOR}({_NUMBER})(?![\w.])")
_UPWARD = re.compile(r"(?<![a-z0-9])([-+]?)([xyz])[ _-]?(?:axis[ _-]?)?(?:(?:is|points)[ _-])?(up|down)(?![a-z])")


_MAKER = re.compile(
    r"(?:file |splats? )?(?:generated|created|exported|written|saved|made|produced)\b", re.IGNORECASE
)


def is_antialiased(comments: Iterable[str]) -> bool:
    """Tell whether a scene was trained with antialiasing: the last comment that speaks of it decides."""
    antialiased = False
    for comment in comments:
        match comment.split():
            case [word, value] if word == MODE:
                antialiased = value == "mip"
            case [word, value] if word == FLAG:
                antialiased = value == "1"
    return antialiased


def said_up(comments: Iterable[str]) -> Vector | None:
    """Return the unit vector that is up, or None; the last comment that speaks of it decides."""
    said = [up for comment in comments if (up := up_of(comment))]
    return said[-1] if said else None


def up_of(comment: str) -> Vector | None:
    """Return the unit vector that one comment says is up; None where it says none, or only that it is along y."""
    text = comment.lower()
    if found := _VECTOR.search(text):
        return _unit([float(word) for word in found.groups()])
    if found := _UPWARD.search(text):
        sign, axis, way = found.groups()
        return _along(axis, (sign == "-") != (way == "down"))
    if found := _AXIS.search(text):
        sign, axis = found.groups()
        # Of the vertical axis y, either end may be up, and is: COLMAP's scenes have -y up.
        return None if "vertical" in found[0] and axis == "y" and not sign else _along(axis, sign == "-")
    return None


def comment_lines(gaussians: Gaussians) -> list[bytes]:
    """Return the lines of a header that say how it was trained and what is up, and all other comments."""
    kept = gaussians.extra.comments if gaussians.extra else ()
    said = [line.decode("ascii", "backslashreplace").partition(" ")[2] for line in kept]
    as_said = said_up(said) == gaussians.up
    lines = [
        line
        for line, text in zip(kept, said, strict=True)
        if not _of_training(text) and (as_said or up_of(text) is None)
    ]
    if gaussians.antialiased:
        lines.append(f"comment {MODE} mip".encode())
    if gaussians.up and not as_said:
        lines.append(f"comment Vertical Axis: {_called(gaussians.up)}".encode())
    return lines


def matters(line: bytes) -> bool:
    """Tell whether a comment says something that `Gaussians` does not, other than who wrote the file."""
    text = line.decode("ascii", "backslashreplace").partition(" ")[2].strip()
    return bool(text) and not (_of_training(text) or up_of(text) or _MAKER.match(text))


def _of_training(comment: str) -> bool:
    match comment.split():
        case [word, _] if word in (MODE, FLAG):
            return True
    return False


def _called(up: Vector) -> str:
    """Return the axis that is up, or three numbers where it is none."""
    largest = max(range(3), key=lambda axis: abs(up[axis]))
    if abs(up[largest]) > 1.0 - 1e-9:
        # Without a sign, y might be either.
        return ("-" if up[largest] < 0.0 else "+" if largest == 1 else "") + "xyz"[largest]
    return " ".join(f"{value:.9g}" for value in up)


def _along(axis: str, negative: bool) -> Vector:
    up = [0.0, 0.0, 0.0]
    up["xyz".index(axis)] = -1.0 if negative else 1.0
    return up[0], up[1], up[2]


def _unit(vector: list[float]) -> Vector | None:
    length = float(np.linalg.norm(vector))
    if not 0.0 < length < math.inf:
        return None
    x, y, z = (value / length for value in vector)
    return x, y, z
