"""What a caller may ask of a reader, checked once; a reader takes what concerns its format."""

from __future__ import annotations

from dataclasses import dataclass

from tsplat.errors import OptionError

SPZ_FRAMES = (
    "ldb", "rdb", "lub", "rub", "ldf", "rdf", "luf", "ruf", "lbd", "rbd", "lbu", "rbu", "lfd", "rfd", "lfu", "rfu",
)  # fmt: skip
"""Axes that an SPZ may be in, each by its directions: left or right, up or down, back or front. In the order of
the numbers from 1 that its record of them has."""


FORMAT_NAMES = ("ply", "splat", "ksplat", "spz", "sog", "glb", "gltf", "npz", "tsplat")
"""Formats that may be asked for, by their suffixes."""


@dataclass(frozen=True, slots=True)
class LoadOptions:
    """How to read a scene.

    Attributes
    ----------
    max_splats : int, optional
        Keep at most this many, those with the largest opacity times area; by default all.
    raw_opacity : bool
        A PLY holds opacities from 0 to 1 where others hold logits.
    spz_frame : str, optional
        The axes of an SPZ, one of `SPZ_FRAMES`. By default those that it says, else ``rub``: right, up, back, as
        specified. Some writers keep a PLY's ``rdf`` and do not say so.
    lod : int, optional
        Which level of detail of a streamed scene, 0 the finest; None for all of them, one over the other.
    format : str, optional
        One of `FORMAT_NAMES`, whatever the file and its name say; by default what they say.

    Raises
    ------
    OptionError
        A value is out of its range.
    """

    max_splats: int | None = None
    raw_opacity: bool = False
    spz_frame: str | None = None
    lod: int | None = 0
    format: str | None = None

    def __post_init__(self) -> None:
        if self.max_splats is not None and self.max_splats < 1:
            raise OptionError(f"max_splats must be 1 or more, got {self.max_splats}")
        if self.spz_frame not in (None, *SPZ_FRAMES):
            raise OptionError(f"spz_frame must be one of {', '.join(SPZ_FRAMES)}, got {self.spz_frame!r}")
        if self.lod is not None and self.lod < 0:
            raise OptionError(f"lod must be 0 or more, got {self.lod}")
        if self.format not in (None, *FORMAT_NAMES):
            raise OptionError(f"format must be one of {', '.join(FORMAT_NAMES)}, got {self.format!r}")
