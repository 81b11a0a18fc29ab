"""glTF files: real ones beside their PLY twins, and every way that numbers may lie in one."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from tests.io.alike import matrix
from tests.io.gltfs import EXTENSION, Made, attributes_of, check_alike, load_made, scene_of
from tests.io.splat_files import SCENES, apart, likeness, needs_scenes
from tests.io.spzs import Splat, bare, zipped
from tests.scenes import random_gaussians
from tsplat import io
from tsplat.errors import LoadWarning
from tsplat.io import gltf_accessors, gltf_transform
from tsplat.raster.reference import sh_basis
from tsplat.scene import SH_C0, Gaussians

HALF_TURN = np.diag([-1.0, -1.0, 1.0])
"""From +Y up to +Y down."""


def turned(gaussians: Gaussians) -> Gaussians:
    """Return a scene as it is read when a glTF has its arrays as they are."""
    w, x, y, z = gaussians.quats.T
    directions = np.random.default_rng(0).normal(size=(64, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    k = gaussians.sh.shape[1]
    seen = np.einsum("dk,nkc->dnc", sh_basis(directions)[:, :k], gaussians.sh).reshape(64, -1)
    sh = np.linalg.lstsq(sh_basis(directions @ HALF_TURN)[:, :k], seen, rcond=None)[0]
    sh = sh.reshape(k, len(gaussians), 3).transpose(1, 0, 2)
    quats = np.stack([-z, -y, x, w], axis=1)
    return Gaussians(gaussians.means @ HALF_TURN, quats, gaussians.scales, gaussians.opacities, sh)


@needs_scenes
@pytest.mark.parametrize("name", ["yashica", "playbot31k"])
def test_real_files_agree_with_their_ply_twins(name: str) -> None:
    assert SCENES is not None
    found = io.load(SCENES / "format_matrix" / f"{name}.glb")
    truth = io.load(SCENES / "format_matrix" / f"{name}.ply")
    np.testing.assert_array_equal(found.means, truth.means)
    np.testing.assert_array_equal(found.sh, truth.sh)
    np.testing.assert_allclose(found.scales, truth.scales, rtol=3e-7)
    np.testing.assert_allclose(found.opacities, truth.opacities, atol=1e-7)
    assert apart(found.quats, truth.quats) < 1e-6
    assert likeness(found, truth) > 80.0


def test_a_splat_made_by_hand_is_read_field_by_field(tmp_path: Path) -> None:
    made = Made()
    attributes = {
        "POSITION": made.accessor([[1.0, 2.0, 3.0]]),
        f"{EXTENSION}:ROTATION": made.accessor([[math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]]),
        f"{EXTENSION}:SCALE": made.accessor([[0.1, 0.2, 0.3]]),
        f"{EXTENSION}:OPACITY": made.accessor([0.25]),
        f"{EXTENSION}:SH_DEGREE_0_COEF_0": made.accessor([[0.5, -0.5, 1.0]]),
    }
    made.primitive(attributes)
    found = load_made(tmp_path, made)
    assert found.means.tolist() == [[-1.0, -2.0, 3.0]]
    np.testing.assert_allclose(found.scales, [[0.1, 0.2, 0.3]], rtol=1e-6)
    assert found.opacities.tolist() == [0.25]
    assert found.sh.tolist() == [[[0.5, -0.5, 1.0]]]
    # A quarter turn about x takes y to z; half a turn about z leaves z there and y comes from below.
    expected = HALF_TURN @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    np.testing.assert_allclose(matrix(found.quats[0]), expected, atol=1e-6)


@pytest.mark.parametrize("degree", range(4))
@pytest.mark.parametrize("name", ["scene.glb", "SCENE.GLTF"])
def test_a_scene_is_read_turned_upright(tmp_path: Path, rng: np.random.Generator, degree: int, name: str) -> None:
    before = random_gaussians(rng, 50, degree)
    made = scene_of(before)
    check_alike(load_made(tmp_path, made.glb() if name == "scene.glb" else made.gltf(), name), turned(before))


NUMBERS = {
    ("int8", True): ([-128, -127, 0, 64, 127], [-1.0, -1.0, 0.0, 64 / 127, 1.0]),
    ("uint8", True): ([0, 51, 255], [0.0, 0.2, 1.0]),
    ("int16", True): ([-32768, -32767, 0, 32767], [-1.0, -1.0, 0.0, 1.0]),
    ("uint16", True): ([0, 13107, 65535], [0.0, 0.2, 1.0]),
    ("int8", False): ([-128, 5, 127], [-128.0, 5.0, 127.0]),
    ("uint8", False): ([0, 7, 255], [0.0, 7.0, 255.0]),
    ("int16", False): ([-32768, 9, 32767], [-32768.0, 9.0, 32767.0]),
    ("uint16", False): ([0, 9, 65535], [0.0, 9.0, 65535.0]),
    ("uint32", False): ([0, 9, 1 << 24], [0.0, 9.0, float(1 << 24)]),
    ("float32", False): ([-0.5, 0.0, 1e30], [-0.5, 0.0, 1e30]),
    ("float32", True): ([-0.5, 0.0, 3.0], [-0.5, 0.0, 3.0]),
}


@pytest.mark.parametrize(("dtype", "normalized"), NUMBERS)
def test_every_kind_of_number_means_what_the_specification_says(
    tmp_path: Path, dtype: str, normalized: bool
) -> None:
    stored, meant = NUMBERS[dtype, normalized]
    made = scene_of(random_gaussians(np.random.default_rng(0), len(stored), 0))
    more = {"normalized": True} if normalized else {}
    rows = np.repeat(np.array(stored)[:, None], 3, axis=1)
    made.root["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = made.accessor(rows, dtype, **more)
    np.testing.assert_allclose(load_made(tmp_path, made).means[:, 2], meant, rtol=1e-6)


def test_integers_of_rotations_and_opacities_are_shares_said_or_not(tmp_path: Path) -> None:
    gaussians = random_gaussians(np.random.default_rng(0), 3, 0)
    for more in ({}, {"normalized": True}):
        made = scene_of(gaussians)
        attributes = made.root["meshes"][0]["primitives"][0]["attributes"]
        attributes[f"{EXTENSION}:OPACITY"] = made.accessor([0, 128, 255], "uint8", **more)
        attributes[f"{EXTENSION}:ROTATION"] = made.accessor([[0, 0, 0, 127]] * 3, "int8", **more)
        found = load_made(tmp_path, made)
        np.testing.assert_allclose(found.opacities, [0, 128 / 255, 1], rtol=1e-6)
        np.testing.assert_allclose(np.abs(found.quats), [[0, 0, 0, 1]] * 3)


def interleaved(gaussians: Gaussians, padding: int) -> Made:
    """Return a glTF whose attributes take turns, splat by splat."""
    made = Made()
    arrays = {
        "POSITION": gaussians.means,
        f"{EXTENSION}:ROTATION": gaussians.quats[:, [1, 2, 3, 0]],
        f"{EXTENSION}:SCALE": gaussians.scales,
        f"{EXTENSION}:OPACITY": gaussians.opacities[:, None],
        f"{EXTENSION}:SH_DEGREE_0_COEF_0": gaussians.sh[:, 0],
    }
    rows = np.concatenate([np.zeros((len(gaussians), padding), np.float32), *arrays.values()], axis=1)
    stride = rows.shape[1] * 4
    view = made.view(rows.tobytes(), byteStride=stride)
    attributes, offset = {}, 4 * padding
    for name, array in arrays.items():
        kind = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}[array.shape[1]]
        accessor = {"bufferView": view, "byteOffset": offset, "componentType": 5126, "count": len(rows)}
        made.root["accessors"].append(accessor | {"type": kind})
        attributes[name] = len(made.root["accessors"]) - 1
        offset += 4 * array.shape[1]
    made.primitive(attributes)
    return made


@pytest.mark.parametrize("padding", [0, 1, 40])
def test_attributes_may_take_turns_splat_by_splat(
    tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch, padding: int
) -> None:
    monkeypatch.setattr(gltf_accessors, "CHUNK_BYTES", 700)
    before = random_gaussians(rng, 40, 0)
    check_alike(load_made(tmp_path, interleaved(before, padding)), turned(before))


def test_chunks_join_without_a_seam(
    tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gltf_accessors, "CHUNK_BYTES", 50)
    monkeypatch.setattr(gltf_transform, "CHUNK", 7)
    before = random_gaussians(rng, 30, 2)
    check_alike(load_made(tmp_path, scene_of(before)), turned(before))


def test_sparse_rows_stand_in_for_others(tmp_path: Path, rng: np.random.Generator) -> None:
    before = random_gaussians(rng, 10, 0)
    for dtype in ("uint8", "uint16", "uint32"):
        made = scene_of(before)
        code = {"uint8": 5121, "uint16": 5123, "uint32": 5125}[dtype]
        made.root["accessors"][0]["sparse"] = {
            "count": 2,
            "indices": {"bufferView": made.view(np.array([3, 9], dtype).tobytes()), "componentType": code},
            "values": {"bufferView": made.view(np.array([[1, 2, 3], [4, 5, 6]], np.float32).tobytes())},
        }
        found = load_made(tmp_path, made)
        assert found.means[[3, 9]].tolist() == [[-1, -2, 3], [-4, -5, 6]]
        np.testing.assert_array_equal(found.means[4:9], (before.means @ HALF_TURN)[4:9].astype(np.float32))


def test_buffers_lie_beside_the_file_and_in_it(tmp_path: Path, rng: np.random.Generator) -> None:
    before = random_gaussians(rng, 20, 1)
    made = scene_of(before)
    (tmp_path / "sub folder").mkdir()
    (tmp_path / "sub folder" / "a.bin").write_bytes(made.content)
    check_alike(load_made(tmp_path, made.gltf("sub%20folder/a.bin"), "scene.gltf"), turned(before))
    # The first half of the views in the GLB itself, the others in a file beside it.
    views = made.root["bufferViews"]
    made.root["buffers"] = [{}, {"byteLength": len(made.content), "uri": "sub folder/a.bin"}]
    for view in views[len(views) // 2 :]:
        view["buffer"] = 1
    check_alike(load_made(tmp_path, made), turned(before))


def test_the_first_bytes_decide_and_of_json_what_it_holds(tmp_path: Path) -> None:
    made = scene_of(random_gaussians(np.random.default_rng(0), 4, 0))
    assert len(load_made(tmp_path, made, "scene.ply")) == 4
    assert len(load_made(tmp_path, made, "scene.gltf")) == 4, "a GLB under the other name"
    assert len(load_made(tmp_path, b"\xef\xbb\xbf \n" + made.gltf(), "scene.gltf")) == 4
    assert len(load_made(tmp_path, made.gltf(), "scene.json")) == 4


def test_meshes_primitives_and_nodes_follow_each_other(tmp_path: Path, rng: np.random.Generator) -> None:
    parts = [random_gaussians(rng, 5, 2), random_gaussians(rng, 6, 0), random_gaussians(rng, 7, 1)]
    made = Made()
    made.root["meshes"] = [{"primitives": []}, {"primitives": []}]
    for mesh, part in zip((0, 0, 1), parts, strict=True):
        made.primitive(attributes_of(made, part), mesh)
    triangles = {"attributes": {"POSITION": made.accessor(np.zeros((3, 3)))}, "extensions": {"EXT_other": {}}}
    made.root["meshes"][0]["primitives"].insert(1, triangles)
    made.root["nodes"] = [{"children": [2, 1]}, {"mesh": 1}, {"mesh": 0}, {"mesh": 1}]
    made.root["scenes"] = [{"nodes": []}, {"nodes": [0, 3]}]
    made.root["scene"] = 1
    found = load_made(tmp_path, made)
    order = [0, 1, 2, 2]
    expected = [turned(parts[index]) for index in order]
    np.testing.assert_array_equal(found.means, np.concatenate([each.means for each in expected]))
    assert found.sh.shape == (25, 9, 3)
    assert not found.sh[5:11, 1:].any()
    assert not found.sh[11:, 4:].any()
    np.testing.assert_allclose(found.sh[11:18, :4], expected[2].sh, atol=4e-6)


def test_without_scenes_or_nodes_everything_is_shown(tmp_path: Path, rng: np.random.Generator) -> None:
    made = scene_of(random_gaussians(rng, 5, 0))
    del made.root["scene"], made.root["scenes"]
    made.root["nodes"] = [{"mesh": 0}, {"children": [0], "translation": [0, 0, 7]}]
    assert load_made(tmp_path, made).means[:, 2].min() > 5.0
    del made.root["nodes"]
    assert load_made(tmp_path, made).means[:, 2].max() < 2.0


def test_a_limit_keeps_the_weightiest_and_progress_grows_to_one(tmp_path: Path, rng: np.random.Generator) -> None:
    seen: list[float] = []
    made = scene_of(random_gaussians(rng, 40, 1))
    made.root["nodes"] = [{"mesh": 0}, {"mesh": 0}]
    made.root["scenes"] = [{"nodes": [0, 1]}]
    assert len(load_made(tmp_path, made, max_splats=7, progress=seen.append)) == 7
    assert seen == sorted(seen)
    assert (0.0 < seen[0] < 0.5, seen[-1], len(seen) > 5) == (True, 1.0, True)


@pytest.mark.parametrize("kind", [3, 4])
def test_drafts_have_other_names_and_colours_of_points(
    tmp_path: Path, rng: np.random.Generator, kind: int
) -> None:
    before = random_gaussians(rng, 20, 1)
    made = Made()
    attributes = attributes_of(made, before, "_")
    rgba = rng.integers(0, 256, (20, 4))
    attributes["COLOR_0"] = made.accessor(rgba[:, :kind], "uint8", normalized=True)
    del attributes["_SH_DEGREE_0_COEF_0"]
    opacities = before.opacities
    if kind == 4:
        del attributes["_OPACITY"]
        opacities = (rgba[:, 3] / np.float32(255)).astype(np.float32)
    made.primitive(attributes, extensions={EXTENSION: {}})
    sh = before.sh.copy()
    sh[:, 0] = (rgba[:, :3] / 255 - 0.5) / SH_C0
    found = load_made(tmp_path, made)
    check_alike(found, turned(Gaussians(before.means, before.quats, before.scales, opacities, sh)))


def packed(name: str, inside: bool, version: int = 2, flags: int = 0) -> Made:
    splats = [
        Splat((index * 100, 50, -20), quat=(index % 4, 90, 80, 70), sh=list(range(100, 109))) for index in range(5)
    ]
    made = Made()
    extension = {name: {"bufferView": made.view(zipped(bare(splats, version, 1, flags=flags)))}}
    made.root["meshes"] = [{"primitives": [{"mode": 0, "attributes": {}}]}]
    made.root["meshes"][0]["primitives"][0]["extensions"] = (
        {EXTENSION: {"extensions": extension}} if inside else extension
    )
    return made


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(
    ("name", "inside"),
    [
        ("KHR_gaussian_splatting_compression_spz", True),
        ("KHR_gaussian_splatting_compression_spz_2", True),
        ("KHR_spz_gaussian_splats_compression", False),
    ],
)
def test_packed_splats_are_those_of_the_spz_in_axes_of_gltf(
    tmp_path: Path, name: str, inside: bool, version: int
) -> None:
    made = packed(name, inside, version)
    found = load_made(tmp_path, made)
    (tmp_path / "scene.spz").write_bytes(made.content)
    check_alike(found, turned(io.load(tmp_path / "scene.spz", spz_frame="rdf")))


def test_a_scene_is_antialiased_when_all_that_is_packed_says_so(tmp_path: Path) -> None:
    name = "KHR_gaussian_splatting_compression_spz_2"
    assert not load_made(tmp_path, packed(name, True)).antialiased
    made = packed(name, True, flags=1)
    assert load_made(tmp_path, made).antialiased
    made.primitive(attributes_of(made, random_gaussians(np.random.default_rng(0), 3, 1)))
    assert not load_made(tmp_path, made).antialiased


def to_srgb(linear: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0) ** (1 / 2.4) - 0.055)


def test_linear_colours_are_shown_as_srgb(tmp_path: Path, rng: np.random.Generator) -> None:
    before = random_gaussians(rng, 60, 1)
    made = scene_of(before)
    splatting = made.root["meshes"][0]["primitives"][0]["extensions"][EXTENSION]
    splatting["colorSpace"] = "lin_rec709_display"
    found = load_made(tmp_path, made)
    linear = 0.5 + SH_C0 * before.sh[:, 0].astype(np.float64)
    np.testing.assert_allclose(0.5 + SH_C0 * found.sh[:, 0], to_srgb(linear), atol=1e-5)
    # A small change by the view is carried over by the slope of the curve.
    small = 1e-5 * before.sh[:, 2]
    change = (to_srgb(linear + small) - to_srgb(linear - small)) / 2e-5
    np.testing.assert_allclose(found.sh[:, 2], change, rtol=2e-2, atol=1e-4)


def test_what_is_drawn_otherwise_is_said(tmp_path: Path, rng: np.random.Generator) -> None:
    made = scene_of(random_gaussians(rng, 3, 0))
    splatting = made.root["meshes"][0]["primitives"][0]["extensions"][EXTENSION]
    for name in ("kernel", "projection", "colorSpace"):
        splatting[name] = "odd"
        with pytest.warns(LoadWarning, match=rf"scene\.glb: {name} 'odd' is drawn as") as caught:
            load_made(tmp_path, made)
        assert caught[0].filename.endswith("gltfs.py"), "the warning points at the caller of load"
        assert len(caught) == 1
        del splatting[name]


def test_opacities_outside_are_clamped_and_broken_splats_left_out(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    before = random_gaussians(rng, 5, 0)
    made = scene_of(before)
    attributes = made.root["meshes"][0]["primitives"][0]["attributes"]
    attributes[f"{EXTENSION}:OPACITY"] = made.accessor([-1.0, 0.5, 1.5, math.nan, 0.25])
    with pytest.warns(LoadWarning) as caught:
        assert load_made(tmp_path, made).opacities.tolist() == [0.0, 0.5, 1.0, 0.25]
    assert [str(each.message).split(": ", 1)[1] for each in caught] == [
        "2 of 5 opacities lay outside 0 to 1 and were clamped",
        "dropped 1 of 5 splats: nan, inf or a zero quat",
    ]
