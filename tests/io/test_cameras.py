"""Training cameras: what cameras.json says."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

import tsplat
from tests.io.outcomes import limited_growth
from tests.scenes import shared_scenes
from tsplat import io
from tsplat.errors import CorruptFileError, LoadError
from tsplat.io.camera_json import MAX_BYTES

SCENES = shared_scenes()
NEEDS_SCENES = pytest.mark.skipif(
    SCENES is None, reason="no folder of real scenes: set TSPLAT_SCENES or have ../shared/scenes"
)


def entry(**changes: Any) -> dict[str, Any]:
    """Return a camera at (1, 2, 3) that looks along +x with +y down."""
    axes_in_columns = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    camera = {"id": 0, "img_name": "one", "width": 640, "height": 480, "position": [1, 2, 3]}
    return {**camera, "rotation": axes_in_columns, "fx": 500.0, "fy": 510.0, **changes}


def write(folder: Path, content: Any) -> Path:
    path = folder / "cameras.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_a_camera_stands_where_the_file_says_and_looks_where_it_says(tmp_path: Path) -> None:
    [training] = io.load_cameras(write(tmp_path, [entry()]))
    camera = training.camera
    assert (training.name, camera.width, camera.height) == ("one", 640, 480)
    np.testing.assert_allclose(camera.eye, [1, 2, 3])
    ahead = camera.viewmat @ [4, 2, 3, 1]
    np.testing.assert_allclose(ahead[:3], [0, 0, 3], atol=1e-12)
    np.testing.assert_allclose(camera.K, [[500, 0, 320], [0, 510, 240], [0, 0, 1]])


def test_an_entry_without_a_name_is_called_by_its_place(tmp_path: Path) -> None:
    nameless = entry()
    del nameless["img_name"]
    assert [each.name for each in io.load_cameras(write(tmp_path, [entry(), nameless]))] == ["one", "1"]


FAULTS: dict[str, tuple[Any, str]] = {
    "not JSON": ("[{]", "at byte 2: is not JSON"),
    "not UTF-8": (None, "is not JSON"),
    "too deep": ("[" * 100_000, "is not JSON"),
    "an object": ({}, "holds a JSON dict, expected a list"),
    "a number for a camera": ([3], "camera 0: expected rotation 3x3"),
    "no position": ([entry(), {"rotation": entry()["rotation"]}], "camera 1: field 'position' is missing"),
    "two coordinates": ([entry(position=[1, 2])], "camera 0: expected"),
    "a word for a focal length": ([entry(fx="wide")], "camera 0: expected"),
    "no focal length": ([entry(fx=0)], "camera 0: focal lengths must be positive"),
    "no width": ([entry(width=0)], "camera 0: width must be 1 to"),
    "endless width": ([entry(width=math.inf)], "camera 0: expected"),
    "a mirror": ([entry(rotation=[[1, 0, 0], [0, 1, 0], [0, 0, -1]])], "camera 0: viewmat must hold a rotation"),
    "axes beyond all bounds": ([entry(rotation=[[1e300] * 3] * 3)], "camera 0: viewmat must "),
    "nan": ([entry(position=[math.nan, 0, 0])], "camera 0: viewmat must be finite"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_broken_list_is_one_clear_line(tmp_path: Path, name: str) -> None:
    content, message = FAULTS[name]
    path = write(tmp_path, content)
    if content is None:
        path.write_bytes(b"\xff\xfe[")
    with pytest.raises(CorruptFileError, match=message) as caught:
        io.load_cameras(path)
    assert "\n" not in str(caught.value)


def test_a_short_list_takes_no_room_for_the_longest(tmp_path: Path) -> None:
    path = write(tmp_path, [entry()])
    with limited_growth(MAX_BYTES // 4):
        assert len(io.load_cameras(path)) == 1


def test_a_missing_list_cannot_be_loaded(tmp_path: Path) -> None:
    with pytest.raises(LoadError, match="No such file"):
        io.load_cameras(tmp_path / "cameras.json")


@NEEDS_SCENES
def test_real_cameras_see_what_their_photographs_show() -> None:
    assert SCENES is not None
    cameras = io.load_cameras(SCENES / "snowmiku" / "cameras.json")
    assert len(cameras) == 97
    scene = io.load(SCENES / "snowmiku" / "trained" / "snow_sh3_3000.ply")
    for training in cameras[1:97:32]:
        with Image.open(SCENES / "snowmiku" / "images_16" / f"{training.name}.png") as image:
            photo = np.asarray(image.convert("RGB"), np.float64) / 255.0
        height, width = photo.shape[:2]
        drawn = np.clip(tsplat.render(scene, training.camera.resized(width, height)).colors, 0.0, 1.0)
        assert psnr(drawn, photo) > 24.0, training.name
        assert psnr(drawn[:, ::-1], photo) < 20.0, "the picture of a mirror"


def psnr(one: npt.NDArray[Any], other: npt.NDArray[Any]) -> float:
    return float(-10.0 * np.log10(np.mean((one - other) ** 2)))
