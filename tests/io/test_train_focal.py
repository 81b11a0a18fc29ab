"""The focal length of the training images: where it is looked for, and at what size they were trained on."""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.io.side_files import looked_at
from tests.io.test_cameras import entry
from tests.scenes import shared_scenes
from tsplat.errors import CorruptFileError, LoadError, LoadWarning
from tsplat.io import load_cameras, train_focal_beside, training_beside
from tsplat.io.transforms import load_lenses
from tsplat.train_views import TrainViews

SCENES = shared_scenes()


def write(folder: Path, name: str, content: Any) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def focal(folder: Path) -> float | None:
    return train_focal_beside(folder / "scene.ply")


def lens(**fields: Any) -> dict[str, Any]:
    return {"fl_x": 500.0, "w": 640, "h": 480, "frames": [{"file_path": "images/1.png"}], **fields}


def test_it_is_the_median_of_the_nearest_list(tmp_path: Path) -> None:
    folder = tmp_path / "point_cloud" / "iteration_30000"
    folder.mkdir(parents=True)
    assert focal(folder) is None
    write(tmp_path, "cameras.json", [entry(fx=each) for each in (100.0, 900.0, 300.0)])
    assert focal(folder) == 300.0
    write(folder, "cameras.json", [])
    assert train_focal_beside(str(folder / "scene.ply")) is None


@pytest.mark.parametrize("name", ["cameras.json", "transforms.json", "transforms_train.json"])
def test_a_list_four_folders_above_is_somebody_elses(tmp_path: Path, name: str) -> None:
    write(tmp_path, name, [entry()] if name == "cameras.json" else lens())
    assert focal(tmp_path / "a" / "b" / "c") == 500.0
    assert focal(tmp_path / "a" / "b" / "c" / "d") is None


def test_other_names_are_not_looked_for(tmp_path: Path) -> None:
    write(tmp_path, "transforms_test.json", lens())
    write(tmp_path, "transforms_images_16.json", lens())
    assert focal(tmp_path) is None


def test_in_one_folder_the_list_that_training_wrote_comes_first(tmp_path: Path) -> None:
    for name, fl_x in (("transforms_train.json", 1.0), ("transforms.json", 2.0)):
        write(tmp_path, name, lens(fl_x=fl_x))
        assert focal(tmp_path) == fl_x
    write(tmp_path, "cameras.json", [entry(fx=3.0)])
    assert focal(tmp_path) == 3.0


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (None, 3000.0 * 1600 / 4000),
        ("Namespace(images='images', resolution=-1)", 3000.0 * 1600 / 4000),
        ("Namespace(images='images', resolution=1)", 3000.0),
        ("Namespace(images='images', resolution=4)", 750.0),
        ("Namespace(images='images', resolution=500)", 375.0),
        ("Namespace(images='images_4', resolution=-1)", 750.0),
        ("Namespace(images='images_2', resolution=-1)", 3000.0 * 1600 / 4000),
        ("Namespace(images='/data/images_8', resolution=2)", 3000.0 / 16),
        ("\xff resolution= images=3", 3000.0 * 1600 / 4000),
    ],
)
def test_cameras_are_scaled_to_the_size_that_was_trained_at(
    tmp_path: Path, arguments: str | None, expected: float
) -> None:
    write(tmp_path, "cameras.json", [entry(fx=3000.0, width=4000)])
    if arguments is not None:
        write(tmp_path, "cfg_args", arguments)
    assert focal(tmp_path) == pytest.approx(expected)


def test_the_only_folder_with_photographs_says_how_small_they_were(tmp_path: Path) -> None:
    write(tmp_path, "cameras.json", [entry(fx=3000.0, width=4000)])
    (tmp_path / "images_8").mkdir()
    assert focal(tmp_path) == pytest.approx(375.0)
    write(tmp_path, "cfg_args", "Namespace(images='images_4')")
    assert focal(tmp_path) == pytest.approx(750.0)
    (tmp_path / "cfg_args").unlink()
    (tmp_path / "images").mkdir()
    assert focal(tmp_path) == pytest.approx(3000.0 * 1600 / 4000)


def test_small_photographs_are_trained_as_they_are(tmp_path: Path) -> None:
    write(tmp_path, "cameras.json", [entry(fx=1500.0, width=1600)])
    assert focal(tmp_path) == 1500.0


def test_a_frame_has_its_own_lens_or_that_of_all(tmp_path: Path) -> None:
    frames = [{"fl_x": 100.0}, {}, {"fl_x": 300.0, "w": 10, "h": 20}]
    path = write(tmp_path, "transforms.json", lens(fl_x=200.0, frames=frames))
    assert load_lenses(path) == [(100.0, 640, 480), (200.0, 640, 480), (300.0, 10, 20)]
    assert focal(tmp_path) == 200.0


def test_an_angle_and_a_width_are_a_focal_length(tmp_path: Path) -> None:
    write(tmp_path, "transforms_train.json", {"camera_angle_x": math.pi / 2, "w": 800, "frames": [{}]})
    assert focal(tmp_path) == pytest.approx(400.0)


@pytest.mark.parametrize("name", ["./train/r_0", "train/r_0.png"])
def test_a_width_that_is_not_given_is_the_pictures(tmp_path: Path, name: str) -> None:
    (tmp_path / "train").mkdir()
    Image.new("L", (600, 400)).save(tmp_path / "train" / "r_0.png")
    document = {"camera_angle_x": math.pi / 2, "frames": [{"file_path": name}]}
    write(tmp_path, "transforms_train.json", document)
    assert focal(tmp_path) == pytest.approx(300.0)


def test_a_picture_outside_of_the_folder_is_not_opened(tmp_path: Path) -> None:
    Image.new("L", (600, 400)).save(tmp_path / "r.png")
    for name in ("../r.png", str(tmp_path / "r.png")):
        path = write(tmp_path / "scene", "transforms.json", {"fl_x": 1.0, "frames": [{"file_path": name}]})
        with pytest.raises(CorruptFileError, match="frame 0: field 'w' is missing"):
            load_lenses(path)


@pytest.mark.parametrize(
    ("name", "width", "height", "expected"),
    [
        ("transforms.json", 1600, 1200, 1000.0),
        ("transforms.json", 1601, 1200, 500.0),
        ("transforms.json", 1200, 3300, 250.0),
        ("transforms_train.json", 2000, 4000, 800.0),
    ],
)
def test_lenses_are_scaled_as_their_trainer_does(
    tmp_path: Path, name: str, width: int, height: int, expected: float
) -> None:
    write(tmp_path, name, lens(fl_x=1000.0, w=width, h=height))
    assert focal(tmp_path) == pytest.approx(expected)


def test_cameras_say_what_they_had_in_view(tmp_path: Path) -> None:
    path = write(tmp_path, "cameras.json", [entry(), entry(position=[4, 5, 6], fx=700.0)])
    focal, views = training_beside(tmp_path / "inner" / "scene.ply")
    expected = TrainViews.of([each.camera for each in load_cameras(path)])
    assert focal == 600.0
    assert views is not None
    assert expected is not None
    np.testing.assert_array_equal(views.frusta, expected.frusta)


def test_cameras_out_of_reach_of_every_number_are_no_error(tmp_path: Path) -> None:
    write(tmp_path, "cameras.json", [entry(position=[1e300, 0, -1e300])])
    focal, views = training_beside(tmp_path / "scene.ply")
    assert focal == 500.0
    assert views is not None


@pytest.mark.parametrize("name", ["transforms.json", "transforms_train.json"])
def test_a_list_in_other_axes_than_the_scene_says_nothing_of_views(tmp_path: Path, name: str) -> None:
    write(tmp_path, name, lens(frames=[{"transform_matrix": np.eye(4).tolist()}]))
    assert training_beside(tmp_path / "scene.ply") == (500.0, None)


FAULTS: dict[str, tuple[str, Any, str]] = {
    "cameras not JSON": ("cameras.json", "[{]", "at byte 2: is not JSON"),
    "camera without fx": ("cameras.json", [{}], "camera 0: field 'rotation' is missing"),
    "transforms not JSON": ("transforms.json", "{", "is not JSON, expected an object with cameras"),
    "a list": ("transforms.json", [], "holds a JSON list, expected an object with cameras"),
    "too deep": ("transforms.json", "[" * 100_000, "is not JSON"),
    "no frames": ("transforms.json", {"fl_x": 1.0}, "field 'frames' is no list of objects"),
    "frames of numbers": ("transforms.json", lens(frames=[1]), "field 'frames' is no list of objects"),
    "no lens": (
        "transforms.json",
        {"w": 4, "frames": [{}]},
        "frame 0: field 'fl_x' or 'camera_angle_x' is missing",
    ),
    "no width": ("transforms.json", {"fl_x": 4, "frames": [{}]}, "frame 0: field 'w' is missing"),
    "a word": ("transforms.json", lens(fl_x="wide"), "frame 0: fl_x must be a number above 0, got 'wide'"),
    "nan": ("transforms.json", lens(fl_x=math.nan), "fl_x must be a number above 0, got nan"),
    "endless": ("transforms.json", lens(w=math.inf), "w must be a number above 0, got inf"),
    "no height": ("transforms.json", lens(h=0), "h must be a number above 0, got 0"),
    "true": ("transforms.json", lens(w=True), "w must be a number above 0, got True"),
    "half a circle": (
        "transforms.json",
        {"camera_angle_x": 3.2, "w": 8, "frames": [{}]},
        "camera_angle_x must be more than 1e-06 and less than pi, got 3.2",
    ),
    "an angle of nothing": (
        "transforms.json",
        {"camera_angle_x": 1e-320, "w": 8, "frames": [{}]},
        "camera_angle_x must be more than 1e-06 and less than pi, got 9.99",
    ),
    "an angle of nearly half a circle": (
        "transforms.json",
        {"camera_angle_x": math.nextafter(math.pi, 0.0), "w": 8, "frames": [{}]},
        "gives a focal length of .* pixels, expected 0.1 to 1e\\+07",
    ),
    "as long as can be": ("cameras.json", [entry(fx=1e308, width=1)], "focal length of 1e\\+308 pixels"),
    "next to nothing": ("cameras.json", [entry(fx=5e-324)], "focal length of 4.94066e-324 pixels"),
    "beyond float64": (
        "transforms.json",
        lens(fl_x=10**400),
        "fl_x must be a number above 0, got <int of 1329 bits>",
    ),
    "more digits than are read": (
        "transforms.json",
        '{"frames": [{"w": ' + "9" * 9999 + "}]}",
        "w must be .*, got inf",
    ),
    "deep": (
        "transforms.json",
        '{"frames": [{"w": ' + "[" * 400 + "]" * 400 + "}]}",
        r"w must be .*, got \[<list>\]",
    ),
    "a width of digits": ("cameras.json", [entry(width=10**400)], "camera 0: expected rotation 3x3"),
    "a name as deep as it goes": (
        "cameras.json",
        json.dumps([entry(fx=0, img_name="deep")]).replace('"deep"', "[" * 900 + "]" * 900),
        "camera 0: focal lengths must be positive",
    ),
    "values without end": ("cameras.json", "[" + "{}," * 3_000_000 + "{}]", "holds more than 2097152 values"),
    "frames without end": (
        "transforms.json",
        lens(frames=[{}] * 100_001),
        "lists 100001 frames",
    ),
    "second frame": ("transforms.json", lens(frames=[{}, {"w": -1}]), "frame 1: w must be a number above 0"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_broken_list_is_one_line_and_does_not_stop_a_viewer(tmp_path: Path, name: str) -> None:
    file_name, content, message = FAULTS[name]
    write(tmp_path, file_name, content)
    with pytest.warns(LoadWarning, match=message) as caught:
        assert training_beside(tmp_path / "scene.ply") == (None, None)
    assert "\n" not in str(caught[0].message)


PANORAMAS: dict[str, dict[str, Any]] = {
    "by its model": {"camera_model": "EQUIRECTANGULAR", "frames": [{"w": 5760}]},
    "in small letters": {"camera_model": "spherical", "w": 5760, "h": 2880, "fl_x": "none", "frames": [{}]},
    "by the model of a frame": {"frames": [{"camera_model": "OMNIDIRECTIONALSTEREO_L"}]},
    "by its size": {"w": 5760, "h": 2880, "frames": [{}, {"fl_x": None}]},
}


@pytest.mark.parametrize("name", PANORAMAS)
@pytest.mark.parametrize("file_name", ["transforms.json", "transforms_train.json"])
def test_panoramas_have_no_focal_length_and_nothing_is_said(tmp_path: Path, name: str, file_name: str) -> None:
    write(tmp_path, file_name, PANORAMAS[name])
    assert training_beside(tmp_path / "scene.ply") == (None, None)


def test_among_panoramas_photographs_count(tmp_path: Path) -> None:
    frames = [{"camera_model": "EQUIRECTANGULAR"}, {"fl_x": 300.0, "w": 600, "h": 300}]
    write(tmp_path, "transforms.json", {"frames": frames})
    assert focal(tmp_path) == 300.0


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP"])
def test_a_picture_broken_at_any_byte_is_a_calm_line_or_its_size(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "a.png"
    Image.new("RGB", (600, 400)).save(path, kind)
    write(tmp_path, "transforms.json", {"camera_angle_x": math.pi / 2, "frames": [{"file_path": "a.png"}]})
    whole, found = path.read_bytes(), 0
    for place in range(0, 120, 3):
        for content in (whole[:place], whole[:place] + b"\xff\0" + whole[place + 2 :]):
            path.write_bytes(content)
            found += looked_at(tmp_path / "transforms.json").focal is not None
    assert 0 < found < 80


@pytest.mark.parametrize("kind", ["DDS", "JPEG2000", "GIF", "TIFF"])
def test_no_other_decoder_sees_a_picture_of_a_strangers(tmp_path: Path, kind: str) -> None:
    Image.new("RGB", (600, 400)).save(tmp_path / "a.png", kind)
    write(tmp_path, "transforms.json", {"camera_angle_x": 1.0, "frames": [{"file_path": "a.png"}]})
    with pytest.warns(LoadWarning, match="frame 0: field 'w' is missing"):
        assert focal(tmp_path) is None


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir, lambda path: os.symlink("/dev/zero", path)])
def test_what_is_no_file_is_not_waited_for(tmp_path: Path, make: Callable[[Path], None]) -> None:
    for name in ("cameras.json", "transforms.json", "cfg_args", "a.png"):
        make(tmp_path / name)
    document = {"camera_angle_x": math.pi / 2, "frames": [{"file_path": "a.png"}]}
    write(tmp_path, "transforms_train.json", document)
    with pytest.warns(LoadWarning, match="frame 0: field 'w' is missing"):
        assert focal(tmp_path) is None
    with pytest.raises(LoadError, match="is a folder or a device"):
        load_cameras(tmp_path / "transforms.json")


def test_what_holds_for_all_frames_is_not_copied_for_each(tmp_path: Path) -> None:
    many = {f"field {number}": number for number in range(30_000)}
    write(tmp_path, "transforms.json", lens(frames=[{}] * 30_000, **many))
    start = time.process_time()
    assert focal(tmp_path) == 500.0
    assert time.process_time() - start < 20.0  # copied, they would take hours


def test_of_many_cameras_some_tell_enough(tmp_path: Path) -> None:
    path = write(tmp_path, "cameras.json", [entry(fx=100.0 + index % 7) for index in range(4500)])
    assert 2000 <= len(load_cameras(path, 2000)) < 2500
    assert len(load_cameras(path, 1000)) == 1125
    start = time.process_time()
    assert focal(tmp_path) == 103.0
    assert time.process_time() - start < 5.0


def test_no_frames_are_no_focal_length(tmp_path: Path) -> None:
    write(tmp_path, "transforms.json", lens(frames=[]))
    assert training_beside(tmp_path / "scene.ply") == (None, None)
    write(tmp_path, "cameras.json", [])
    assert training_beside(tmp_path / "scene.ply") == (None, None)


@pytest.mark.skipif(SCENES is None, reason="no folder of real scenes: set TSPLAT_SCENES or have ../shared/scenes")
def test_the_real_ones_agree(tmp_path: Path) -> None:
    assert SCENES is not None
    beside = train_focal_beside(SCENES / "snowmiku" / "trained" / "snow_sh3_3000.ply")
    original = (SCENES / "snowmiku" / "transforms_images_16.json").read_text()
    write(tmp_path, "transforms.json", original)
    assert focal(tmp_path) == pytest.approx(205.3247)
    assert beside == pytest.approx(205.3247, rel=0.003)
