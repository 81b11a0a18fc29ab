"""Cameras that a scene was trained from, as ``cameras.json`` beside it lists them.

Source: the training code of Kerbl et al. 2023, whose entries hold ``position`` and ``rotation`` of the
camera in the world (the columns of ``rotation`` are the camera's axes), and focal lengths in pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tsplat import given
from tsplat.camera import Camera
from tsplat.errors import CameraError, CorruptFileError
from tsplat.io.camera_json import read_json

MOST_CHARS = 200
"""Of what is wrong with a camera: its numbers may have hundreds of digits."""


@dataclass(frozen=True, slots=True)
class TrainingCamera:
    """A photograph's name and the camera that took it."""

    name: str
    camera: Camera


def load_cameras(path: str | Path, most: int | None = None) -> list[TrainingCamera]:
    """Read a ``cameras.json``.

    Parameters
    ----------
    path : str or Path
        The file.
    most : int, optional
        Of more cameras, about so many spread evenly over the list; by default all.

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
    path = given.path(path)
    entries = read_json(path, list)
    step = 1 if most is None else max(1, len(entries) // given.whole("most", most, 1))
    with np.errstate(over="ignore", invalid="ignore"):  # what that makes is no rotation, and refused
        return [_camera(path, index, entries[index]) for index in range(0, len(entries), step)]


def _camera(path: Path, index: int, entry: Any) -> TrainingCamera:
    try:
        rotation = np.array(entry["rotation"], np.float64)
        position = np.array(entry["position"], np.float64)
        width, height = int(entry["width"]), int(entry["height"])
        viewmat = np.eye(4)
        viewmat[:3, :3], viewmat[:3, 3] = rotation.T, -rotation.T @ position
        K = np.array([[entry["fx"], 0.0, width / 2], [0.0, entry["fy"], height / 2], [0.0, 0.0, 1.0]], np.float64)
        name = entry.get("img_name")
        return TrainingCamera(name if isinstance(name, str) else str(index), Camera(viewmat, K, width, height))
    except KeyError as error:
        problem = f"camera {index}: field {error} is missing; export it again"
        raise CorruptFileError(path, problem) from error
    except CameraError as error:
        raise CorruptFileError(path, f"camera {index}: {str(error)[:MOST_CHARS]}; export it again") from error
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        expected = "rotation 3x3, position 3, width, height, fx and fy as numbers"
        raise CorruptFileError(path, f"camera {index}: expected {expected}; export it again") from error
