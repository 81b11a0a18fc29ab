"""``transforms.json``: the lenses that photographs were taken with, as NeRF's data sets and nerfstudio have them.

Source: https://docs.nerf.studio/quickstart/data_conventions.html for ``fl_x``, ``w`` and ``h``, given once or by
frame; Mildenhall et al. 2020, *NeRF*, whose synthetic scenes have ``camera_angle_x`` in radians and no size.
"""

from __future__ import annotations

import math
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from PIL import Image

from tsplat.errors import CorruptFileError
from tsplat.io.camera_json import read_json
from tsplat.io.sog_files import is_inside


class Lens(NamedTuple):
    """The focal length fx of a photograph and its size, all in pixels."""

    focal: float
    width: float
    height: float


def load_lenses(path: Path) -> list[Lens]:
    """Read the lens of every frame.

    Returns
    -------
    list of Lens
        In file order. A size that is not given is that of the first frame's picture.

    Raises
    ------
    LoadError
        The file cannot be read.
    CorruptFileError
        It is no JSON object with frames, or a frame has no lens; the text names the frame and the field.
    """
    document = read_json(path, dict)
    frames = document.get("frames")
    if not isinstance(frames, list) or not all(isinstance(frame, dict) for frame in frames):
        raise CorruptFileError(path, "field 'frames' is no list of objects; export it again")
    if frames and any("w" not in {**document, **frame} for frame in frames):
        document = {**_size_of_picture(path, frames[0]), **document}
    return [_lens(path, index, {**document, **frame}) for index, frame in enumerate(frames)]


def _lens(path: Path, index: int, fields: dict[str, Any]) -> Lens:
    width = _positive(path, index, fields, "w")
    height = _positive(path, index, fields, "h") if "h" in fields else width
    if "fl_x" in fields:
        return Lens(_positive(path, index, fields, "fl_x"), width, height)
    angle = _positive(path, index, fields, "camera_angle_x", "'fl_x' or 'camera_angle_x'")
    if angle >= math.pi:
        raise CorruptFileError(path, f"frame {index}: camera_angle_x must be less than pi, got {angle:g}")
    return Lens(0.5 * width / math.tan(0.5 * angle), width, height)


def _positive(path: Path, index: int, fields: dict[str, Any], name: str, called: str = "") -> float:
    value = fields.get(name)
    if value is None:
        raise CorruptFileError(path, f"frame {index}: field {called or repr(name)} is missing; export it again")
    if type(value) not in (int, float) or not 0.0 < value < 1e9:
        raise CorruptFileError(path, f"frame {index}: {name} must be a number above 0, got {value!r:.40}")
    return float(value)


def _size_of_picture(path: Path, frame: dict[str, Any]) -> dict[str, Any]:
    """Return w and h of a frame's picture, or nothing; NeRF's names lack the suffix ``.png``."""
    name = frame.get("file_path")
    if not is_inside(name):
        return {}
    place = path.parent / PurePosixPath(str(name))
    try:
        with Image.open(place if place.suffix else place.with_suffix(".png")) as picture:
            return {"w": picture.width, "h": picture.height}
    except (OSError, ValueError, Image.DecompressionBombError):
        return {}
