"""What a caller may ask of a reader, checked once; a reader takes what concerns its format."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsplat.errors import OptionError, shown
from tsplat.given import whole

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
        A PLY or .npz holds opacities from 0 to 1 where others hold logits.
    spz_frame : str, optional
        The axes of an SPZ, one of `SPZ_FRAMES`. By default those that it says, else ``rub``: right, up, back, as
        specified. Some writers keep a PLY's ``rdf`` and do not say so.
    lod : int, optional
        Which level of detail of a streamed scene, 0 the finest; None for all of them, one over the other.
    format : str, optional
        One of `FORMAT_NAMES`, whatever the file and its name say; by default what they say.
    raw_scales : bool
        A PLY or .npz holds scales in world units where others hold their logarithms.
    extra : bool
        Keep what else a PLY holds: columns and elements of its own, comments.

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
    raw_scales: bool = False
    extra: bool = False

    def __post_init__(self) -> None:
        if self.max_splats is not None:
            object.__setattr__(self, "max_splats", whole("max_splats", self.max_splats, 1))
        for name in ("raw_opacity", "raw_scales", "extra"):
            if not isinstance(getattr(self, name), (bool, np.bool_)):
                raise OptionError(f"{name} must be True or False, got {shown(getattr(self, name))}")
        for name, known in (("spz_frame", SPZ_FRAMES), ("format", FORMAT_NAMES)):
            value = getattr(self, name)
            if value is not None and not (isinstance(value, str) and value in known):
                raise OptionError(f"{name} must be one of {', '.join(known)}, got {shown(value)}")
        if self.lod is not None:
            object.__setattr__(self, "lod", whole("lod", self.lod, 0))
