"""Saved glTF files: taken apart by other means, beside those of another writer, and read again."""

from __future__ import annotations

import base64
import json
import struct
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from tests.io.splat_files import SCENES, likeness, needs_scenes
from tests.scenes import random_gaussians
from tsplat import io
from tsplat.errors import SaveError, SaveWarning
from tsplat.io import gltf_write
from tsplat.scene import Gaussians

PREFIX = "KHR_gaussian_splatting:"


def taken_apart(raw: bytes) -> tuple[dict[str, Any], bytes]:
    """Return the JSON and the buffer of a GLB, its container checked on the way."""
    magic, version, length, text_length, kind = struct.unpack_from("<4sIII4s", raw)
    assert (magic, version, length, kind) == (b"glTF", 2, len(raw), b"JSON")
    assert text_length % 4 == 0
    at = 20 + text_length
    content_length, kind = struct.unpack_from("<I4s", raw, at)
    assert (content_length, kind) == (len(raw) - at - 8, b"BIN\0")
    return json.loads(raw[20:at]), raw[at + 8 :]


def attributes(raw: bytes) -> dict[str, npt.NDArray[Any]]:
    """Return the numbers of the one primitive by their names."""
    root, content = taken_apart(raw)
    found = {}
    for name, index in root["meshes"][0]["primitives"][0]["attributes"].items():
        accessor = root["accessors"][index]
        view = root["bufferViews"][accessor["bufferView"]]
        dtype, size = {5126: ("<f4", 4), 5121: ("u1", 1)}[accessor["componentType"]]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        assert start % 4 == 0
        assert view["byteLength"] == accessor["count"] * width * size
        found[name] = np.frombuffer(content, dtype, accessor["count"] * width, start).reshape(-1, width)
    return found


@pytest.mark.parametrize("degree", range(5))
@pytest.mark.parametrize("name", ["scene.glb", "scene.gltf"])
def test_what_is_saved_is_read_again_to_the_bit(
    tmp_path: Path, rng: np.random.Generator, degree: int, name: str
) -> None:
    before = random_gaussians(rng, 200, degree)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SaveWarning)  # of degree 4
        after = io.load(io.save(tmp_path / name, before))
    for field in ("means", "scales", "opacities"):
        np.testing.assert_array_equal(getattr(after, field), getattr(before, field))
    np.testing.assert_array_equal(after.sh, before.sh[:, :16], "degree 4 has no names")
    # Quats are made one long once more.
    np.testing.assert_allclose(after.quats, before.quats, atol=1.2e-7)


@needs_scenes
@pytest.mark.parametrize("name", ["yashica", "playbot31k"])
def test_another_writer_makes_the_same_numbers_of_a_real_scene(tmp_path: Path, name: str) -> None:
    assert SCENES is not None
    truth = io.load(SCENES / "format_matrix" / f"{name}.ply")
    ours = attributes(io.save(tmp_path / "scene.glb", truth).read_bytes())
    theirs = attributes((SCENES / "format_matrix" / f"{name}.glb").read_bytes())
    assert ours.keys() == theirs.keys()
    for key in ours.keys() - {"COLOR_0", f"{PREFIX}ROTATION"}:
        np.testing.assert_allclose(ours[key], theirs[key], rtol=4e-7, atol=1e-7, err_msg=key)
    cosines = np.sum(ours[f"{PREFIX}ROTATION"] * theirs[f"{PREFIX}ROTATION"], axis=1)
    np.testing.assert_allclose(np.abs(cosines), 1.0, atol=1e-6)
    np.testing.assert_allclose(ours["COLOR_0"][:, 3] / 255, theirs["COLOR_0"][:, 3] / 255, atol=1.01 / 255)
    assert likeness(io.load(tmp_path / "scene.glb"), truth) > 80.0


def test_a_splat_is_written_as_the_specification_says(tmp_path: Path) -> None:
    sh = np.zeros((1, 4, 3))
    sh[0, 0], sh[0, 1:] = [0.0, 9.0, -9.0], [[1, 2, 3], [4, 5, 6], [7, 8, 9]]
    scene = Gaussians(
        np.array([[1.0, 2.0, 3.0]]),
        np.array([[1.0, 0.0, 0.0, 0.0]]),
        np.array([[0.0, 0.25, 8.0]]),
        np.array([1.0]),
        sh,
    )
    raw = io.save(tmp_path / "scene.glb", scene).read_bytes()
    found = {name: values.tolist()[0] for name, values in attributes(raw).items()}
    assert found["POSITION"] == [-1, -2, 3]
    assert [abs(each) for each in found[f"{PREFIX}ROTATION"]] == [0, 0, 1, 0]
    assert found[f"{PREFIX}SCALE"] == [0, 0.25, 8]
    assert found[f"{PREFIX}OPACITY"] == [1]
    assert found[f"{PREFIX}SH_DEGREE_0_COEF_0"] == [0, 9, -9]
    # The first is that of y, the second of z, the third of x: half a turn about z changes the sign of two.
    assert [found[f"{PREFIX}SH_DEGREE_1_COEF_{m}"][0] for m in range(3)] == [-1, 4, -7]
    assert found["COLOR_0"] == [55, 255, 0, 255], "half of sRGB is 0.214 of the light"
    root, _ = taken_apart(raw)
    assert root["asset"]["version"] == "2.0"
    assert root["extensionsUsed"] == ["KHR_gaussian_splatting"]
    assert root["accessors"][0]["min"] == root["accessors"][0]["max"] == [-1, -2, 3]
    assert root["accessors"][1]["normalized"] is True
    primitive = root["meshes"][0]["primitives"][0]
    assert primitive["mode"] == 0
    splatting = {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}
    assert primitive["extensions"] == {"KHR_gaussian_splatting": splatting}


def test_bounds_of_the_positions_are_those_of_the_numbers(tmp_path: Path, rng: np.random.Generator) -> None:
    raw = io.save(tmp_path / "scene.glb", random_gaussians(rng, 100, 0)).read_bytes()
    positions, accessor = attributes(raw)["POSITION"], taken_apart(raw)[0]["accessors"][0]
    assert accessor["min"] == positions.min(axis=0).tolist()
    assert accessor["max"] == positions.max(axis=0).tolist()


def test_both_suffixes_hold_the_same(tmp_path: Path, rng: np.random.Generator) -> None:
    for count in (1, 2, 3):  # as many as it takes for base64 to end in every way
        scene = random_gaussians(rng, count, 1)
        root, content = taken_apart(io.save(tmp_path / "scene.glb", scene).read_bytes())
        text = json.loads(io.save(tmp_path / "scene.gltf", scene).read_bytes())
        kind, _, encoded = text["buffers"][0].pop("uri").partition(",")
        assert kind == "data:application/octet-stream;base64"
        assert base64.b64decode(encoded, validate=True) == content
        assert text == root


def test_chunks_join_without_a_seam(
    tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = random_gaussians(rng, 50, 2)
    for name in ("scene.glb", "scene.gltf"):
        monkeypatch.setattr(gltf_write, "CHUNK_SPLATS", 1000)
        whole = io.save(tmp_path / name, scene).read_bytes()
        monkeypatch.setattr(gltf_write, "CHUNK_SPLATS", 7)
        assert io.save(tmp_path / name, scene).read_bytes() == whole


@pytest.mark.parametrize("name", ["scene.glb", "scene.gltf"])
def test_a_scene_of_no_splats_is_refused_and_leaves_nothing_behind(tmp_path: Path, name: str) -> None:
    empty = random_gaussians(np.random.default_rng(0), 0, 0)
    with pytest.raises(SaveError, match=r"the scene has no splats, and a glTF cannot say so; save as \.ply"):
        io.save(tmp_path / name, empty)
    assert not list(tmp_path.iterdir())


def test_more_than_a_glb_can_say_is_refused(
    tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = random_gaussians(rng, 50, 0)
    size = io.save(tmp_path / "scene.glb", scene).stat().st_size
    monkeypatch.setattr(gltf_write, "GLB_BYTES", size - 1)
    with pytest.raises(SaveError, match=rf"needs {size} bytes, a GLB holds up to {size - 1}; save as \.gltf or"):
        io.save(tmp_path / "scene.glb", scene)
    assert len(io.load(io.save(tmp_path / "scene.gltf", scene))) == 50
