"""Sizes of scenes in one file and in many."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.scenes import random_gaussians, shared_scenes
from tsplat.io import demo_path, save
from tsplat.io.on_disk import OnDisk, look

SCENES = shared_scenes()


def write(path: Path, content: object) -> int:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else json.dumps(content).encode())
    return path.stat().st_size


def test_a_file_is_what_it_takes() -> None:
    assert look(demo_path()) == OnDisk("PLY", demo_path().stat().st_size, files=1, scenes=1)


@pytest.mark.filterwarnings("ignore::tsplat.errors.SaveWarning")  # a .splat has no harmonics
def test_the_format_is_told_by_the_bytes_and_where_these_fit_two_by_the_name(tmp_path: Path) -> None:
    scene = random_gaussians(np.random.default_rng(1), 300)
    for suffix, name in (
        (".ply", "PLY"),
        (".compressed.ply", "compressed PLY"),
        (".splat", "splat"),
        (".spz", "SPZ"),
    ):
        assert look(save(tmp_path / f"scene{suffix}", scene)).format == name
    odd = tmp_path / "scene.spz"
    odd.write_bytes((tmp_path / "scene.ply").read_bytes())
    assert look(odd).format == "PLY"


def test_a_json_takes_what_it_names_inside_its_folder_and_nothing_else(tmp_path: Path) -> None:
    folder = tmp_path / "scene"
    size = write(folder / "a.webp", b"1234") + write(folder / "deep" / "b.webp", b"12")
    write(folder / "other.webp", b"not named")
    write(tmp_path / "outside.webp", b"not inside")
    named = ["a.webp", "a.webp", "deep/b.webp", "../outside.webp", "missing.webp", "", 7, None, str(tmp_path)]
    size += write(folder / "meta.json", {"means": {"files": named}})
    assert look(folder / "meta.json") == OnDisk("SOG", size, files=3, scenes=1)


def test_a_streamed_scene_takes_what_its_pieces_name(tmp_path: Path) -> None:
    size = write(tmp_path / "lod-meta.json", {"tree": {}, "filenames": ["0/meta.json", "1/meta.json"]})
    for level in "01":
        # Each names itself and the whole, which must not go round in circles.
        size += write(tmp_path / level / "meta.json", {"files": ["x.webp", "meta.json", "../lod-meta.json"]})
        size += write(tmp_path / level / "x.webp", b"12345")
    assert look(tmp_path / "lod-meta.json") == OnDisk("SOG", size, files=5, scenes=2)


def test_what_is_no_json_names_nothing(tmp_path: Path) -> None:
    path = tmp_path / "x.json"
    assert look(path).files == 1 if write(path, b"{" + b"[" * 100_000) else False
    path.write_bytes(b'{"a": ')
    assert look(path).files == 1


@pytest.mark.skipif(SCENES is None, reason="no folder of real scenes: set TSPLAT_SCENES")
def test_the_streamed_robot_takes_all_files_of_its_folder_but_the_credit() -> None:
    assert SCENES is not None
    files = [path for path in (SCENES / "playbot").rglob("*") if path.is_file() and path.suffix != ".txt"]
    expected = OnDisk("SOG", sum(path.stat().st_size for path in files), files=len(files), scenes=7)
    assert look(SCENES / "playbot" / "lod-meta.json") == expected
