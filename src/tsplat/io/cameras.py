"""Cameras that a scene was trained from, as ``cameras.json`` beside it lists them.

Source: the training code of Kerbl et al. 2023, whose entries hold ``position`` and ``rotation`` of the
camera in the world (the columns of ``rotation`` are the camera's axes), and focal lengths in pixels.
"""

from __future__ import annotations

import json
import statistics
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tsplat.camera import Camera
from tsplat.errors import CameraError, CorruptFileError, LoadError, LoadWarning
from tsplat.io.sources import is_elsewhere

FILE_NAME = "cameras.json"
LEVELS_UP = 3
"""Folders searched above the scene's: training writes ``point_cloud/iteration_30000/point_cloud.ply``."""

MAX_BYTES = 1 << 28
"""Larger files are no camera lists; this one would be half a million photographs."""


@dataclass(frozen=True, slots=True)
class TrainingCamera:
    """A photograph's name and the camera that took it."""

    name: str
    camera: Camera


def load_cameras(path: str | Path) -> list[TrainingCamera]:
    """Read a ``cameras.json``.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    list of TrainingCamera
        In file order, each at the size and focal length of its entry, principal point in the middle.

    Raises
    ------
    LoadError
        The file cannot be read.
    CorruptFileError
        It is no JSON list of cameras; the text names the entry and the field.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            text = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise LoadError(path, f"cannot be read: {error.strerror or error}; check the path") from error
    if len(text) > MAX_BYTES:
        raise LoadError(path, f"is larger than {MAX_BYTES} bytes, too large for a list of cameras; choose another")
    try:
        entries = json.loads(text)
    except (ValueError, RecursionError) as error:
        offset = error.pos if isinstance(error, json.JSONDecodeError) else None
        raise CorruptFileError(path, "is not JSON, expected a list of cameras; export it again", offset) from error
    if not isinstance(entries, list):
        raise CorruptFileError(path, f"holds a JSON {type(entries).__name__}, expected a list of cameras")
    return [_camera(path, index, entry) for index, entry in enumerate(entries)]


def train_focal_beside(scene_path: str | Path) -> float | None:
    """Return the median fx, in pixels, of the cameras listed beside a scene or up to three folders above.

    Returns
    -------
    float or None
        None where there is no such list, or an empty one, or the scene is no file.

    Warns
    -----
    LoadWarning
        The list is broken: the scene can be shown all the same.
    """
    if is_elsewhere(scene_path):
        return None
    folder = Path(scene_path).absolute().parent
    for candidate in (folder, *folder.parents[:LEVELS_UP]):
        path = candidate / FILE_NAME
        if path.is_file():
            break
    else:
        return None
    try:
        cameras = load_cameras(path)
    except LoadError as error:
        warnings.warn(f"{error}; a common focal length is assumed", LoadWarning, stacklevel=2)
        return None
    return statistics.median(float(each.camera.K[0, 0]) for each in cameras) if cameras else None


def _camera(path: Path, index: int, entry: Any) -> TrainingCamera:
    try:
        rotation = np.array(entry["rotation"], np.float64)
        position = np.array(entry["position"], np.float64)
        width, height = int(entry["width"]), int(entry["height"])
        viewmat = np.eye(4)
        viewmat[:3, :3], viewmat[:3, 3] = rotation.T, -rotation.T @ position
        K = np.array([[entry["fx"], 0.0, width / 2], [0.0, entry["fy"], height / 2], [0.0, 0.0, 1.0]], np.float64)
        return TrainingCamera(str(entry.get("img_name", index)), Camera(viewmat, K, width, height))
    except KeyError as error:
        problem = f"camera {index}: field {error} is missing; export it again"
        raise CorruptFileError(path, problem) from error
    except CameraError as error:
        raise CorruptFileError(path, f"camera {index}: {error}") from error
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        expected = "rotation 3x3, position 3, width, height, fx and fy as numbers"
        raise CorruptFileError(path, f"camera {index}: expected {expected}; export it again") from error
