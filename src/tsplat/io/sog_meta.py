"""What the meta.json of one SOG scene says, versions 1 and 2 brought to one shape.

Version 2 names values by codebooks, version 1 by ranges cut into 256 steps; both become tables here.

Source: the SOG specification on developer.playcanvas.com (version 2), PlayCanvas' engine (version 1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tsplat.io.sog_json import Fields
from tsplat.io.sog_planes import PIXELS_MAX

F64 = npt.NDArray[np.float64]

LEVELS = 256
ANTIALIASED = "antialiased"
"""What the field ``model`` says of a scene trained with antialiasing."""

PALETTE_MAX = 1 << 16
"""A label has two bytes."""


@dataclass(frozen=True, slots=True)
class Palette:
    """How the colours beyond degree 0 are stored.

    Attributes
    ----------
    centroids, labels : str
        Names of the planes.
    values : ndarray of float64, [n]
        What a byte of a centroid stands for.
    count, bands : int, optional
        How many centroids and SH degrees; None where only the size of the plane says so.
    """

    centroids: str
    labels: str
    values: F64
    count: int | None
    bands: int | None


@dataclass(frozen=True, slots=True)
class Meta:
    """How the planes of a scene are to be understood.

    Attributes
    ----------
    count : int
        Number of splats.
    means_l, means_u, quats, scales, sh0 : str
        Names of the planes.
    mins, maxs : ndarray of float64, [3]
        What 0 and 65535 of a mean stand for, after the symmetric logarithm.
    scale_values : ndarray of float64, [3, n]
        What a byte of a scale stands for, a natural logarithm.
    sh0_values : ndarray of float64, [3, n]
        What a byte of the colour stands for.
    opacity_values : ndarray of float64, [256]
        What a byte of the opacity stands for, from 0 to 1.
    palette : Palette, optional
        Colours beyond degree 0.
    antialiased : bool
        As in `Gaussians`.
    """

    count: int
    means_l: str
    means_u: str
    quats: str
    scales: str
    sh0: str
    mins: F64
    maxs: F64
    scale_values: F64
    sh0_values: F64
    opacity_values: F64
    palette: Palette | None
    antialiased: bool


def parse_meta(fields: Fields) -> Meta:
    """Return what a meta.json says.

    Raises
    ------
    CorruptFileError
        A field is missing or of another kind, or the version is not known.
    """
    means, scales, sh0 = fields.inner("means"), fields.inner("scales"), fields.inner("sh0")
    if fields.has("version"):
        fields.count("version", 1, 2)
    if fields.values.get("version") == 2:
        count = fields.count("count", 0, PIXELS_MAX)
        # A log scale may be minus infinity.
        scale_values = np.tile(_codebook(scales, infinite=True), (3, 1))
        sh0_values = np.tile(_codebook(sh0), (3, 1))
        opacity_values = np.arange(LEVELS) / (LEVELS - 1)
        palette = _palette(fields.inner("shN")) if fields.has("shN") else None
    else:
        count = _shape(means)
        scale_values, steps = _steps(scales, 3), _steps(sh0, 4)
        with np.errstate(over="ignore"):
            sh0_values, opacity_values = steps[:3], 1.0 / (1.0 + np.exp(-steps[3]))
        palette = _old_palette(fields.inner("shN")) if fields.has("shN") else None
    means_l, means_u = means.names("files", 2)[:2]
    quats, scale_plane, sh0_plane = (each.names("files", 1)[0] for each in (fields.inner("quats"), scales, sh0))
    mins, maxs = means.numbers("mins", 3, 3), means.numbers("maxs", 3, 3)
    planes = means_l, means_u, quats, scale_plane, sh0_plane
    # The field was ``antialias`` in the first specification of version 2.
    antialiased = fields.values.get("model", fields.values.get("antialias") is True and ANTIALIASED) == ANTIALIASED
    return Meta(count, *planes, mins, maxs, scale_values, sh0_values, opacity_values, palette, antialiased)


def _codebook(fields: Fields, *, infinite: bool = False) -> F64:
    codebook = fields.values.get("codebook")
    if isinstance(codebook, list) and len(codebook) == LEVELS and codebook[0] is None:
        # Some releases of the writer lost the first entry; it goes on from the second as the others do on average.
        rest = Fields(fields.corrupt, {"codebook": codebook[1:]}, fields.where).numbers("codebook", 255, 255)
        return np.concatenate(([rest[0] + (rest[0] - rest[-1]) / (LEVELS - 1)], rest))
    return fields.numbers("codebook", 1, LEVELS, infinite=infinite)


def _palette(fields: Fields) -> Palette | None:
    bands = fields.count("bands", 0, 3) if fields.has("bands") else None
    if bands == 0:
        return None
    count = fields.count("count", 0, PALETTE_MAX) if fields.has("count") else None
    centroids, labels = fields.names("files", 2)[:2]
    return Palette(centroids, labels, _codebook(fields), count, bands)


def _old_palette(fields: Fields) -> Palette:
    centroids, labels = fields.names("files", 2)[:2]
    return Palette(centroids, labels, _steps(fields, 1)[0], None, None)


def _steps(fields: Fields, channels: int) -> F64:
    mins, maxs = fields.numbers("mins", channels, channels), fields.numbers("maxs", channels, channels)
    with np.errstate(over="ignore", invalid="ignore"):
        return np.linspace(mins, maxs, LEVELS, axis=1)


def _shape(means: Fields) -> int:
    shape = means.values.get("shape")
    if not isinstance(shape, list) or not shape:
        raise means.wrong("shape", "[count, 3]")
    return Fields(means.corrupt, {"shape[0]": shape[0]}, means.where).count("shape[0]", 0, PIXELS_MAX)
