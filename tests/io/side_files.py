"""Small honest files that lie beside a scene, to be damaged; and what may come of looking at them."""

from __future__ import annotations

import io
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from tests.io.honest_files import Files
from tests.io.outcomes import read_or_refused
from tsplat.io import training_beside
from tsplat.io.train_focal import FOCALS, Training

AXES = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
CAMERA = {"width": 640, "height": 480, "position": [1, 2, 3], "rotation": AXES, "fx": 500.0, "fy": 510.0}
CFG_ARGS = b"Namespace(images='images_4', model_path='out', resolution=-1, white_background=False)"


def _picture(format_name: str) -> bytes:
    stream = io.BytesIO()
    Image.new("RGB", (12, 8), (200, 100, 50)).save(stream, format_name)
    return stream.getvalue()


def _json(content: Any) -> bytes:
    return json.dumps(content).encode()


def _transforms(name: str, **fields: Any) -> bytes:
    frames = [{"file_path": f"images/{name}", "transform_matrix": np.eye(4).tolist()}, {"w": 640, "h": 480}]
    return _json({"camera_angle_x": 0.69, "camera_model": "OPENCV", **fields, "frames": frames})


SIDE: dict[str, Files] = {
    "cameras.json": {
        "cameras.json": _json([{"id": index, "img_name": f"{index}", **CAMERA} for index in range(2)]),
        "cfg_args": CFG_ARGS,
    },
    "transforms.json": {"transforms.json": _transforms("a.png"), "images/a.png": _picture("PNG")},
    "transforms.json of JPEG": {"transforms.json": _transforms("a.jpg"), "images/a.jpg": _picture("JPEG")},
    "transforms.json of WebP": {"transforms.json": _transforms("a.webp"), "images/a.webp": _picture("WEBP")},
    "transforms_train.json": {
        "transforms_train.json": _transforms("r_0", camera_angle_x=math.pi / 2),
        "images/r_0.png": _picture("PNG"),
    },
    "panorama": {"transforms.json": _transforms("a.jpg", camera_model="EQUIRECTANGULAR"), "images/a.jpg": b""},
}
"""By what they are called; the first file of each is what is looked for."""


def looked_at(path: Path) -> Training:
    """Return what a list of cameras tells of the scene beside it, in a calm line at most; anything else fails."""
    training = read_or_refused(path, lambda: training_beside(path.parent / "scene.ply"))
    assert training is not None, "a list of cameras stopped a scene"
    assert training.focal is None or FOCALS[0] <= training.focal <= FOCALS[1], training.focal
    return training
