"""What a caller may ask of a reader, checked once; a reader takes what concerns its format."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from tsplat.errors import OptionError, shown
from tsplat.given import whole

SpzFrame = Literal["rub", "rdf"]
SPZ_FRAMES: tuple[SpzFrame, ...] = get_args(SpzFrame)


@dataclass(frozen=True, slots=True)
class LoadOptions:
    """How to read a scene.

    Attributes
    ----------
    max_splats : int, optional
        Keep at most this many, those with the largest opacity times area; by default all.
    raw_opacity : bool
        A PLY or .npz holds opacities from 0 to 1 where others hold logits.
    spz_frame : {"rub", "rdf"}
        The axes of an SPZ: right, up, back by its specification; some writers keep a PLY's right, down, front.
    lod : int, optional
        Which level of detail of a streamed scene, 0 the finest; None for all of them, one over the other.
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
    spz_frame: SpzFrame = "rub"
    lod: int | None = 0
    raw_scales: bool = False
    extra: bool = False

    def __post_init__(self) -> None:
        if self.max_splats is not None:
            object.__setattr__(self, "max_splats", whole("max_splats", self.max_splats, 1))
        if not isinstance(self.raw_opacity, (bool, np.bool_)):
            raise OptionError(f"raw_opacity must be True or False, got {shown(self.raw_opacity)}")
        if not (isinstance(self.spz_frame, str) and self.spz_frame in SPZ_FRAMES):
            raise OptionError(f"spz_frame must be {' or '.join(SPZ_FRAMES)}, got {shown(self.spz_frame)}")
        if self.lod is not None:
            object.__setattr__(self, "lod", whole("lod", self.lod, 0))
