"""glTF files that are cut, changed, or say what is not true."""

from __future__ import annotations

import json
import os
import struct
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.io.gltfs import EXTENSION, Made, glb, load_made, scene_of
from tests.io.test_gltf import packed
from tests.scenes import random_gaussians
from tsplat import io
from tsplat.errors import CorruptFileError, LoadError

FIRST = "KHR_gaussian_splatting:"
SPZ = "KHR_gaussian_splatting_compression_spz_2"


def small() -> Made:
    return scene_of(random_gaussians(np.random.default_rng(5), 2, 0))


def with_sparse() -> Made:
    made = small()
    made.root["accessors"][0]["sparse"] = {
        "count": 1,
        "indices": {"bufferView": made.view(b"\1"), "componentType": 5121},
        "values": {"bufferView": made.view(bytes(12))},
    }
    return made


@pytest.mark.parametrize("made", [small(), packed(SPZ, True)])
def test_a_glb_cut_anywhere_is_refused(tmp_path: Path, made: Made) -> None:
    whole = made.glb()
    assert len(load_made(tmp_path, whole)) > 1
    for length in range(len(whole)):
        with pytest.raises(LoadError, match=r"scene\.glb") as caught:
            load_made(tmp_path, whole[:length])
        assert "\n" not in str(caught.value)
        assert isinstance(caught.value, CorruptFileError) or length == 0


def test_a_gltf_cut_anywhere_is_refused(tmp_path: Path) -> None:
    whole = small().gltf()
    assert len(load_made(tmp_path, whole, "scene.gltf")) == 2
    for length in range(len(whole)):
        with pytest.raises(LoadError, match=r"scene\.gltf") as caught:
            load_made(tmp_path, whole[:length], "scene.gltf")
        assert "\n" not in str(caught.value)


def test_a_buffer_beside_the_file_cut_anywhere_is_refused(tmp_path: Path) -> None:
    made = small()
    for length in range(len(made.content)):
        (tmp_path / "a.bin").write_bytes(made.content[:length])
        with pytest.raises(CorruptFileError, match=r"scene\.gltf: field buffers\[0\]\.byteLength is \d+, exp"):
            load_made(tmp_path, made.gltf("a.bin"), "scene.gltf")


Change = Callable[[dict[str, Any]], object]
PRIMITIVE = ("meshes", 0, "primitives", 0)


def put(value: Any, *path: str | int) -> Change:
    """Return what sets a value somewhere in the JSON."""

    def change(root: dict[str, Any]) -> None:
        at: Any = root
        for step in path[:-1]:
            at = at[step]
        at[path[-1]] = value

    return change


def drop(*path: str | int) -> Change:
    def change(root: dict[str, Any]) -> None:
        at: Any = root
        for step in path[:-1]:
            at = at[step]
        del at[path[-1]]

    return change


LIES: list[tuple[Change, str]] = [
    (put(1 << 50, "accessors", 0, "count"), r"accessors\[0\] needs \d+ bytes for 1125899906842624 rows, 24 are"),
    (
        put(10**400, "accessors", 0, "count"),
        r"accessors\[0\]\.count is <int of 1329 bits>, expected a whole number",
    ),
    (put(-1, "accessors", 0, "count"), r"accessors\[0\]\.count is -1"),
    (put(2.0, "accessors", 0, "count"), r"accessors\[0\]\.count is 2\.0"),
    (put(1, "accessors", 1, "count"), r"accessors\[1\]\.count is 1, expected 2 as in POSITION"),
    (
        put(25, "accessors", 0, "byteOffset"),
        r"accessors\[0\]\.byteOffset is 25, expected .* from 0 to 24",
    ),
    (put(4, "accessors", 0, "byteOffset"), r"accessors\[0\] needs 24 bytes for 2 rows, 20 are there"),
    (put("VEC4", "accessors", 0, "type"), r"accessors\[0\]\.type is 'VEC4', expected VEC3"),
    (put(["VEC3"], "accessors", 0, "type"), r"accessors\[0\]\.type is \['VEC3'\]"),
    (put(5124, "accessors", 0, "componentType"), r"componentType is 5124, expected one of 5120"),
    (put([5126], "accessors", 0, "componentType"), r"componentType is \[5126\]"),
    (put(99, "accessors", 0, "bufferView"), r"accessors\[0\]\.bufferView is 99, expected the index of one of 5"),
    (drop("accessors", 0, "bufferView"), r"accessors\[0\]\.bufferView is missing"),
    (drop("accessors"), r"attributes\..*is \d, expected the index of one of 0 accessors"),
    (put({}, "accessors"), r"expected the index of one of 0 accessors"),
    (put(7, "accessors", 0), r"POSITION is 0, expected the index of one of 5 accessors"),
    (put(8, "bufferViews", 0, "byteStride"), r"bufferViews\[0\]\.byteStride is 8, expected .* from 12 to 252"),
    (put(252, "bufferViews", 0, "byteStride"), r"accessors\[0\] needs 264 bytes for 2 rows, 24 are there"),
    (put(1 << 60, "bufferViews", 0, "byteStride"), r"byteStride is 1152921504606846976"),
    (put(10**9, "bufferViews", 0, "byteOffset"), r"bufferViews\[0\]\.byteOffset is 1000000000"),
    (put(10**9, "bufferViews", 0, "byteLength"), r"bufferViews\[0\]\.byteLength is 1000000000"),
    (put(112, "bufferViews", 1, "byteLength"), r"bufferViews\[1\]\.byteLength is 112, expected .* from 0 to 88"),
    (drop("bufferViews", 0, "byteLength"), r"bufferViews\[0\]\.byteLength is missing"),
    (put(1, "bufferViews", 0, "buffer"), r"bufferViews\[0\]\.buffer is 1, expected the index of one of 1 buffers"),
    (put(10**9, "buffers", 0, "byteLength"), r"buffers\[0\]\.byteLength is 1000000000, expected"),
    (drop("buffers", 0, "byteLength"), r"buffers\[0\]\.byteLength is missing"),
    (
        put([{"byteLength": 9}, {}], "buffers"),
        r"bufferViews\[\d\]\.byteOffset is \d+, expected .* 0 to 9",
    ),
    (put("data:0", "buffers", 0, "uri"), r"buffers\[0\]\.uri is 'data:0', expected the name of a file inside"),
    (put("data:,x", "buffers", 0, "uri"), r"buffers\[0\]\.uri is 'data:,x'"),
    (drop(*PRIMITIVE, "attributes"), r"primitives\[0\]\.attributes is missing, expected an object"),
    (drop(*PRIMITIVE, "attributes", "POSITION"), r"attributes\.POSITION is missing, expected the index of an"),
    (drop(*PRIMITIVE, "attributes", f"{FIRST}SCALE"), r"attributes\.KHR_gaussian_splatting:SCALE is missing"),
    (drop(*PRIMITIVE, "attributes", f"{FIRST}OPACITY"), r"attributes\.KHR_gaussian_splatting:OPACITY is missing"),
    (drop(*PRIMITIVE, "attributes", f"{FIRST}SH_DEGREE_0_COEF_0"), r"splatting:SH_DEGREE_0_COEF_0 is missing"),
    (put(4, *PRIMITIVE, "attributes", f"{FIRST}SH_DEGREE_1_COEF_1"), r"SH_DEGREE_1_COEF_0 is missing"),
    (put(4, *PRIMITIVE, "attributes", f"{FIRST}SH_DEGREE_9_COEF_0"), r"SH_DEGREE_1_COEF_0 is missing"),
    (put("x", *PRIMITIVE, "attributes", "POSITION"), r"POSITION is 'x', expected the index of one of 5 accessors"),
    (put([], *PRIMITIVE, "extensions"), r"primitives\[0\]\.extensions is \[\], expected an object"),
    (put("yes", *PRIMITIVE, "extensions", EXTENSION), r"KHR_gaussian_splatting is 'yes', expected an object"),
    (put(3, "scene"), r"field scene is 3, expected the index of one of 1 scenes"),
    (put([], "scenes"), r"field scene is 0, expected the index of one of 0 scenes"),
]


@pytest.mark.parametrize(("change", "problem"), LIES, ids=[problem for _, problem in LIES])
def test_a_lie_is_named(tmp_path: Path, change: Change, problem: str) -> None:
    made = small()
    raw = made.glb()
    change(made.root)
    raw = glb(json.dumps(made.root).encode(), bytes(made.content))
    with pytest.raises(CorruptFileError, match=problem) as caught:
        load_made(tmp_path, raw)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (put(3, "count"), r"sparse\.count is 3, expected a whole number from 1 to 2"),
        (put(5126, "indices", "componentType"), r"indices\.componentType is 5126, expected 5121, 5123 or 5125"),
        (put(0, "values", "bufferView"), None),
        (put(1, "indices", "byteOffset"), r"sparse\.indices needs 1 bytes for 1 rows, 0 are there"),
        (put(2, "indices", "bufferView"), r"sparse\.indices do not ascend within 2 rows"),
        (drop("values"), r"sparse\.values is missing, expected an object"),
    ],
)
def test_a_lie_about_sparse_rows_is_named(tmp_path: Path, change: Change, problem: str | None) -> None:
    made = with_sparse()
    change(made.root["accessors"][0]["sparse"])
    if problem is None:
        assert len(load_made(tmp_path, made)) == 2
        return
    with pytest.raises(CorruptFileError, match=problem):
        load_made(tmp_path, made)


def test_sparse_rows_ascend(tmp_path: Path) -> None:
    made = scene_of(random_gaussians(np.random.default_rng(5), 9, 0))
    for places, fine in (((3, 4), True), ((4, 3), False), ((3, 3), False), ((3, 9), False)):
        made.root["accessors"][0]["sparse"] = {
            "count": 2,
            "indices": {"bufferView": made.view(bytes(places)), "componentType": 5121},
            "values": {"bufferView": made.view(bytes(24))},
        }
        if fine:
            assert not load_made(tmp_path, made).means[3:5].any()
        else:
            with pytest.raises(CorruptFileError, match=r"indices do not ascend within 9 rows"):
                load_made(tmp_path, made)


@pytest.mark.parametrize(
    "uri",
    [
        "../secret.bin",
        "%2e%2e/secret.bin",
        "sub/../../secret.bin",
        "/etc/passwd",
        "%2Fetc%2Fpasswd",
        "file:///etc/passwd",
        "http://example.org/a.bin",
        "C:\\a.bin",
        "a\x1b[2J.bin",
        "missing.bin",
        "pipe.bin",
        "",
        ".",
        7,
        None,
    ],
)
def test_nothing_outside_of_the_folder_is_opened(tmp_path: Path, uri: object) -> None:
    made = small()
    folder = tmp_path / "scene"
    (folder / "sub").mkdir(parents=True)
    (tmp_path / "secret.bin").write_bytes(made.content)
    os.mkfifo(folder / "pipe.bin")
    made.root["buffers"][0] = {"byteLength": len(made.content), "uri": uri}
    with pytest.raises(CorruptFileError, match=r"field buffers\[0\]\.uri is ") as caught:
        load_made(folder, json.dumps(made.root).encode(), "scene.gltf")
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    ("raw", "problem"),
    [
        (b"glTF", "at byte 4: ends in a header of 12 bytes"),
        (glb(b"{}", None, version=1), "at byte 4: is a GLB of version 1, expected 2; convert it"),
        (b"glTF" + struct.pack("<II", 2, 99) + bytes(20), "at byte 8: length: 99 bytes, 32 are there"),
        (b"glTF" + struct.pack("<II", 2, 12), "at byte 12: ends in the head of a chunk"),
        (b"glTF" + struct.pack("<II", 2, 0) + bytes(20), "ends in the head of a chunk"),
        (
            b"glTF" + struct.pack("<III4s", 2, 20, 1 << 30, b"JSON"),
            r"chunk b'JSON' has 1073741824 bytes, 0 are",
        ),
        (
            b"glTF" + struct.pack("<III4s", 2, 20, 0, b"BIN\0"),
            r"at byte 16: first chunk is b'BIN\\x00', exp",
        ),
        (glb(b"{}", None)[:-4] + b"[[[[", "is not JSON, expected an object of a glTF"),
        (glb(b"[" * 100_000, None), "is not JSON, expected an object of a glTF"),
        (glb(b"\xff\xfe{}", None), "is not JSON, expected an object of a glTF"),
        (glb(b"[]", None), "holds a JSON list, expected an object"),
        (glb(b"{}", None), "shows no KHR_gaussian_splatting, so it is no splat scene; choose another"),
        (glb(b'{"a": "data:x;base64,AAA"}', None), "at byte 21: a data URI is no base64"),
        (glb(b"{" + b" " * (1 << 24) + b"}", None), "holds 16777220 bytes of JSON, expected at most 16777216"),
    ],
)
def test_what_is_no_gltf_says_why(tmp_path: Path, raw: bytes, problem: str) -> None:
    with pytest.raises(LoadError, match=problem) as caught:
        load_made(tmp_path, raw)
    assert "\n" not in str(caught.value)


def test_a_chunk_that_is_missing_or_of_another_kind_is_no_buffer(tmp_path: Path) -> None:
    made = small()
    raw = made.glb()
    text = json.dumps(made.root).encode()
    for broken in (glb(text, None), raw.replace(b"BIN\0", b"ODD\0")):
        with pytest.raises(CorruptFileError, match=r"buffers\[0\]\.uri is missing, expected the name of a file"):
            load_made(tmp_path, broken)


def test_only_the_first_buffer_is_the_chunk(tmp_path: Path) -> None:
    made = small()
    made.root["buffers"].append({"byteLength": 24})
    made.root["bufferViews"][0]["buffer"] = 1
    with pytest.raises(CorruptFileError, match=r"buffers\[1\]\.uri is missing, expected the name of a file"):
        load_made(tmp_path, made)


def test_bytes_behind_the_chunks_and_zeros_behind_the_json_do_no_harm(tmp_path: Path) -> None:
    made = small()
    raw = made.glb()
    text = json.dumps(made.root).encode()
    assert len(load_made(tmp_path, raw + bytes(3))) == 2
    assert len(load_made(tmp_path, glb(text + bytes(-len(text) % 4 + 4), bytes(made.content)))) == 2


def test_splats_shown_again_and_again_are_refused_before_there_is_room_for_them(tmp_path: Path) -> None:
    made = scene_of(random_gaussians(np.random.default_rng(1), 2000, 0))
    made.root["nodes"] = [{"mesh": 0}] * 60_000
    made.root["scenes"] = [{"nodes": list(range(60_000))}]
    with pytest.raises(LoadError, match=r"shows 120000000 splats, expected at most 16 for each of 112000 bytes"):
        load_made(tmp_path, made)
    made.root["nodes"] = [{"mesh": 0}] * 40
    made.root["scenes"] = [{"nodes": list(range(40))}]
    assert len(load_made(tmp_path, made)) == 80_000


def test_the_same_buffer_named_twice_does_not_pay_twice(tmp_path: Path) -> None:
    made = scene_of(random_gaussians(np.random.default_rng(1), 2000, 0))
    made.root["meshes"][0]["primitives"] *= 2000
    (tmp_path / "a.bin").write_bytes(made.content)
    made.root["buffers"] = [{"byteLength": len(made.content), "uri": "a.bin"}] * 5
    for index, view in enumerate(made.root["bufferViews"]):
        view["buffer"] = index
    with pytest.raises(LoadError, match=r"shows 4000000 splats, expected at most 16 for each of 112000 bytes"):
        load_made(tmp_path, json.dumps(made.root).encode(), "scene.gltf")


def test_too_many_nodes_are_refused_before_each_is_looked_at(tmp_path: Path) -> None:
    made = small()
    made.root["nodes"] = [{}] * 100_001
    with pytest.raises(CorruptFileError, match=r"has 100001 nodes, expected at most 100000"):
        load_made(tmp_path, made)


def test_quats_whose_squares_leave_float32_are_stretched_like_others(tmp_path: Path) -> None:
    scenes = []
    for length in (1.0, 1e-30, 1e25):
        made = scene_of(random_gaussians(np.random.default_rng(1), 3, 0))
        rotations = made.accessor(np.array([[0.6, 0, 0, 0.8]] * 3) * length)
        made.root["meshes"][0]["primitives"][0]["attributes"][f"{FIRST}ROTATION"] = rotations
        made.root["nodes"] = [{"mesh": 0, "scale": [1, 2, 3]}]
        scenes.append(load_made(tmp_path, made))
    for found in scenes[1:]:
        np.testing.assert_allclose(found.quats, scenes[0].quats, atol=1e-6)
        np.testing.assert_allclose(found.scales, scenes[0].scales, rtol=1e-5)


def test_colours_of_points_without_opacities_are_not_enough(tmp_path: Path) -> None:
    made = small()
    attributes = made.root["meshes"][0]["primitives"][0]["attributes"]
    del attributes[f"{FIRST}OPACITY"]
    attributes["COLOR_0"] = made.accessor(np.zeros((2, 3)), "uint8", normalized=True)
    with pytest.raises(CorruptFileError, match=r"accessors\[5\]\.type is 'VEC3', expected VEC4"):
        load_made(tmp_path, made)


def test_a_negative_scale_is_named_with_its_row(tmp_path: Path) -> None:
    made = small()
    made.root["meshes"][0]["primitives"][0]["attributes"][f"{FIRST}SCALE"] = made.accessor(
        [[1, 1, 1], [1, -0.5, 1]]
    )
    with pytest.raises(CorruptFileError, match=r"row 1 of accessors\[5\] has a scale of -0\.5, expected 0"):
        load_made(tmp_path, made)


@pytest.mark.parametrize("name", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
def test_packed_buffer_views_are_refused_by_name(tmp_path: Path, name: str) -> None:
    made = small()
    made.root["bufferViews"][0]["extensions"] = {name: {}}
    with pytest.raises(LoadError, match=f"is packed with {name}, not read here; unpack it first"):
        load_made(tmp_path, made)


def test_packed_splats_of_another_kind_are_refused_by_name(tmp_path: Path) -> None:
    made = small()
    for name in (f"{EXTENSION}_compression_EGSC", f"{EXTENSION}_compression_spz_3\n\x1b[2J"):
        made.primitive({}, extensions={EXTENSION: {"extensions": {name: {"bufferView": 0}}}})
        with pytest.raises(LoadError, match=r"is packed with KHR_gaussian_splatting_compression_\w+") as caught:
            load_made(tmp_path, made)
        assert str(caught.value).isprintable()
        made.root["meshes"][0]["primitives"].pop()


def test_a_broken_spz_is_told_with_its_place_in_the_file(tmp_path: Path) -> None:
    made = packed(SPZ, True)
    raw = bytearray(made.glb())
    at = raw.index(b"BIN\0") + 4
    raw[at + 40] ^= 0xFF
    with pytest.raises(CorruptFileError, match=rf"at byte \d+: .*{SPZ}\.bufferView: its SPZ ") as caught:
        load_made(tmp_path, bytes(raw))
    assert caught.value.offset is not None
    assert at <= caught.value.offset <= len(raw)


def test_a_buffer_that_shrinks_while_it_is_read_is_refused(tmp_path: Path) -> None:
    made = scene_of(random_gaussians(np.random.default_rng(1), 1000, 1))
    path = tmp_path / "scene.gltf"
    path.write_bytes(made.gltf("a.bin"))
    (tmp_path / "a.bin").write_bytes(made.content)

    def cut(_: float) -> None:
        with (tmp_path / "a.bin").open("r+b") as file:
            file.truncate(100)

    with pytest.raises(CorruptFileError, match=r"accessors\[\d\] ends in row 0 of 1000"):
        io.load(path, progress=cut)


def test_what_a_file_says_costs_no_more_than_it_holds(tmp_path: Path) -> None:
    made = scene_of(random_gaussians(np.random.default_rng(1), 20_000, 3))
    path = tmp_path / "scene.glb"
    path.write_bytes(made.glb())
    tracemalloc.start()
    honest = io.load(path).nbytes
    assert tracemalloc.get_traced_memory()[1] < 4 * honest
    path = tmp_path / "scene.gltf"
    path.write_bytes(made.gltf())
    made.root.clear()
    tracemalloc.reset_peak()
    io.load(path)
    assert tracemalloc.get_traced_memory()[1] < 4 * honest
    tracemalloc.stop()
