"""``transforms.json``: the lenses that photographs were taken with, as NeRF's data sets and nerfstudio have them.

Source: https://docs.nerf.studio/quickstart/data_conventions.html for ``fl_x``, ``w`` and ``h``, given once or by
frame; Mildenhall et al. 2020, *NeRF*, whose synthetic scenes have ``camera_angle_x`` in radians and no size.
"""

from __future__ import annotations

import math
import struct
import warnings
import zlib
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from PIL import Image

from tsplat.errors import CorruptFileError, shown
from tsplat.io.camera_json import read_json
from tsplat.io.sog_files import is_inside

FIELDS = "w", "h", "fl_x", "camera_angle_x", "camera_model"
"""What is of use of a frame, or of what holds for all that do not have their own."""

PANORAMAS = "EQUIRECT", "PANO", "SPHERIC", "OMNI", "VR180", "CUBEMAP"
"""Parts of the names of models that see all around: their pictures have no focal length."""

FRAMES_MAX = 100_000
"""No scene is trained from more photographs."""

LARGEST = 1e9
"""Pixels; whatever is more is no size and no focal length."""

LEAST_ANGLE = 1e-6
"""Radians; no lens sees less."""

PICTURES = "PNG", "JPEG", "WEBP"
"""Formats that photographs to train from have; Pillow's other decoders are not for a stranger's files."""

UNREADABLE = (
    *(OSError, EOFError, SyntaxError, ValueError, TypeError, LookupError, AttributeError),
    *(ArithmeticError, RuntimeError, MemoryError, struct.error, zlib.error, Image.DecompressionBombError),
)
"""What Pillow raises at pictures that are none, or made to be none."""


class Lens(NamedTuple):
    """The focal length fx of a photograph and its size, all in pixels."""

    focal: float
    width: float
    height: float


def load_lenses(path: Path) -> list[Lens]:
    """Read the lens of every frame, but for those of panoramas, which have none.

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
    if len(frames) > FRAMES_MAX:
        raise CorruptFileError(path, f"lists {len(frames)} frames, expected at most {FRAMES_MAX}; export it again")
    # Only what is of use: a file may say much for all frames, and have many.
    listed = [{name: frame.get(name, document.get(name)) for name in FIELDS} for frame in frames]
    if any(fields["w"] is None and not _is_panorama(fields) for fields in listed):
        size = _size_of_picture(path, frames[0])
        listed = [fields if fields["w"] is not None else {**fields, **size} for fields in listed]
    return [_lens(path, index, fields) for index, fields in enumerate(listed) if not _is_panorama(fields)]


def _is_panorama(fields: dict[str, Any]) -> bool:
    model, width, height = fields["camera_model"], fields["w"], fields["h"]
    if isinstance(model, str):
        return any(part in model.upper() for part in PANORAMAS)
    # Some say it by the size alone: all around is twice as wide as from pole to pole.
    given = fields["fl_x"] is not None or fields["camera_angle_x"] is not None
    return not given and _is_number(width) and _is_number(height) and width == 2 * height


def _lens(path: Path, index: int, fields: dict[str, Any]) -> Lens:
    width = _positive(path, index, fields, "w")
    height = _positive(path, index, fields, "h") if fields["h"] is not None else width
    if fields["fl_x"] is not None:
        return Lens(_positive(path, index, fields, "fl_x"), width, height)
    angle = _positive(path, index, fields, "camera_angle_x", "'fl_x' or 'camera_angle_x'")
    if not LEAST_ANGLE < angle < math.pi:
        problem = f"camera_angle_x must be more than {LEAST_ANGLE:g} and less than pi, got {angle:g}"
        raise CorruptFileError(path, f"frame {index}: {problem}; export it again")
    return Lens(0.5 * width / math.tan(0.5 * angle), width, height)


def _positive(path: Path, index: int, fields: dict[str, Any], name: str, called: str = "") -> float:
    value = fields[name]
    if value is None:
        raise CorruptFileError(path, f"frame {index}: field {called or repr(name)} is missing; export it again")
    if not _is_number(value) or not 0.0 < value < LARGEST:
        problem = f"{name} must be a number above 0, got {shown(value)}"
        raise CorruptFileError(path, f"frame {index}: {problem}; export it again")
    return float(value)


def _is_number(value: object) -> bool:
    return type(value) in (int, float)


def _size_of_picture(path: Path, frame: dict[str, Any]) -> dict[str, Any]:
    """Return w and h of a frame's picture, or nothing; NeRF's names lack the suffix ``.png``."""
    name = frame.get("file_path")
    if not isinstance(name, str) or not is_inside(name):
        return {}
    place = path.parent / PurePosixPath(name)
    place = place if place.suffix else place.with_suffix(".png")
    with suppress(*UNREADABLE), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # only its size is looked at
        # Pipes and devices would keep a reader waiting.
        if place.is_file():
            with Image.open(place, formats=PICTURES) as picture:
                return {"w": picture.width, "h": picture.height}
    return {}
