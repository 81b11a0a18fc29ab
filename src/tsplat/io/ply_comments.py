"""What a PLY's comments say about how its scene was trained.

Brush writes ``SplatRenderMode: default``, ``mip`` or ``2dgs``; Postshot writes ``antialiased 0`` or ``1``.
Source: the README of PlayCanvas' splat-transform, which reads both.
"""

from __future__ import annotations

from collections.abc import Iterable

from tsplat.scene import Gaussians

MODE = "SplatRenderMode:"
FLAG = "antialiased"


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


def antialias_comments(gaussians: Gaussians) -> list[str]:
    """Return the lines of a header that keep `Gaussians.antialiased`; none where it is false."""
    return [f"comment {MODE} mip"] if gaussians.antialiased else []
