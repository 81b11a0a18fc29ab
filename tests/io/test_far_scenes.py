"""Files with coordinates of maps: they are read in float64, and written so where the format can."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.io.gltfs import load_made, scene_of
from tests.io.plys import Table, one_splat, ply_bytes, row_bytes, splat_names
from tests.scenes import random_gaussians
from tsplat import edit, io
from tsplat.errors import LoadWarning, SaveError, SaveWarning
from tsplat.lod import open_stored, store
from tsplat.origin import world_means

ECEF = np.array([4510000.25, 1234567.5, 4320000.75])
CLOUD = random_gaussians(np.random.default_rng(6), 60, 1)
FAR = replace(edit.translate(CLOUD, ECEF), up=(0.6, 0.0, 0.8))


@pytest.mark.parametrize("kind", ["binary_little_endian", "binary_big_endian", "ascii"])
@pytest.mark.parametrize("limit", [None, 20])
def test_doubles_of_a_ply_are_read_as_such(tmp_path: Path, kind: str, limit: int | None) -> None:
    world = CLOUD.means.astype(np.float64) + ECEF
    columns = [("double" if name in "xyz" else "float", name) for name in splat_names(0)]
    rows = [one_splat(x=x, y=y, z=z, scale_0=i) for i, (x, y, z) in enumerate(world.tolist())]
    path = tmp_path / "scene.ply"
    path.write_bytes(ply_bytes([Table("vertex", columns, rows)], kind))
    scene = io.load(path, max_splats=limit)
    np.testing.assert_allclose(world_means(scene), world[-(limit or 60) :], rtol=0, atol=1e-5)


def test_floats_of_a_ply_are_kept_to_the_bit(tmp_path: Path) -> None:
    world = (CLOUD.means + ECEF).astype(np.float32)
    path = tmp_path / "scene.ply"
    path.write_bytes(ply_bytes([Table("vertex", [("float", n) for n in splat_names(0)],
                                      [one_splat(x=x, y=y, z=z) for x, y, z in world.tolist()])]))  # fmt: skip
    scene = io.load(path)
    assert scene.origin
    np.testing.assert_array_equal(world_means(scene), world)


def test_doubles_of_a_checkpoint_are_read_as_such(tmp_path: Path) -> None:
    arrays = {"means": CLOUD.means + ECEF, "quats": CLOUD.quats, "scales": np.log(CLOUD.scales)}
    arrays |= {"opacities": np.zeros(60), "sh0": CLOUD.sh[:, :1]}
    np.savez(tmp_path / "scene.npz", **arrays)
    scene = io.load(tmp_path / "scene.npz")
    np.testing.assert_allclose(world_means(scene) - ECEF, CLOUD.means, atol=1e-5)


def test_nodes_of_a_gltf_are_composed_in_doubles(tmp_path: Path) -> None:
    made = scene_of(CLOUD)
    made.root["nodes"] = [
        {"children": [1], "translation": np.add(ECEF, (0, 0, 1e6)).tolist()},
        {"mesh": 0, "matrix": [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 0, 0, -1e6, 1]},
    ]
    scene = load_made(tmp_path, made)
    x, y, z = CLOUD.means.T
    expected = (np.stack([-y, x, z], axis=1) + ECEF) * [-1, -1, 1]
    np.testing.assert_allclose(world_means(scene), expected, rtol=0, atol=1e-5)


@pytest.mark.parametrize("suffix", [".ply", ".glb", ".gltf"])
def test_formats_with_doubles_keep_the_place(tmp_path: Path, suffix: str) -> None:
    scene = replace(FAR, up=None)
    after = io.load(io.save(tmp_path / f"scene{suffix}", scene, strict=True))
    np.testing.assert_allclose(world_means(after), world_means(scene), rtol=0, atol=1e-5)


def test_a_tsplat_keeps_the_place_and_what_is_up(tmp_path: Path) -> None:
    path = tmp_path / "scene.tsplat"
    with path.open("wb") as file:
        store(file, FAR, 1, lambda _: None)
    for scene in (io.load(path), open_stored(path).sample):
        assert (scene.origin, scene.up) == (FAR.origin, FAR.up)


@pytest.mark.parametrize("suffix", [".spz", ".sog", ".splat", ".compressed.ply"])
def test_other_formats_say_that_they_do_not_and_strict_refuses(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"scene{suffix}"
    with pytest.raises(SaveError, match=r"the origin \(4510000\.0, .*nothing is written"):
        io.save(path, FAR, strict=True)
    assert not list(tmp_path.iterdir())
    with pytest.warns(SaveWarning) as caught:
        after = io.load(io.save(path, FAR))
    assert any("the origin (4510000.0, " in str(each.message) for each in caught)
    assert any("is up is left out" in str(each.message) for each in caught) == (suffix != ".compressed.ply")
    assert after.origin is None
    assert np.abs(after.means).max() < 1e3


def test_a_number_that_signals_when_it_is_cast_costs_its_own_splat(tmp_path: Path) -> None:
    columns = [("double" if name == "x" else "float", name) for name in splat_names(0)]
    rows = [one_splat(x=number, opacity=2.0) for number in range(4)]
    content = bytearray(ply_bytes([Table("vertex", columns, rows)]))
    signalling = np.uint32(0x7FA00001).tobytes()  # y of the last splat
    at = len(content) - len(row_bytes(Table("vertex", columns), rows[3], "binary_little_endian")) + 8
    content[at : at + 4] = signalling
    path = tmp_path / "scene.ply"
    path.write_bytes(content)
    with pytest.warns(LoadWarning, match="dropped 1 of 4 splats"):
        assert len(io.load(path)) == 3
