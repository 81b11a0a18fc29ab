"""`load` and `save`: the right format for a file, and one line for everything that is no scene."""

from __future__ import annotations

import os
import zlib
from pathlib import Path

import numpy as np
import pytest

from tests.io.plys import one_splat, ply_bytes, splats
from tests.scenes import random_gaussians
from tsplat import io
from tsplat.errors import CorruptFileError, LoadError, OptionError, SaveError

SCENE = random_gaussians(np.random.default_rng(1), 3, 0)


def test_the_first_bytes_decide_before_the_suffix(tmp_path: Path) -> None:
    path = tmp_path / "scene.jpg"
    path.write_bytes(ply_bytes([splats([one_splat()])]))
    assert len(io.load(str(path))) == 1


def test_a_file_named_ply_that_is_none_says_so(tmp_path: Path) -> None:
    path = tmp_path / "scene.PLY"
    path.write_bytes(b"\x89XYZ\r\n")
    with pytest.raises(CorruptFileError, match=r"at byte 0: begins with b'\\x89XYZ.*expected 'ply'"):
        io.load(path)


def test_an_unknown_format_names_those_that_are_known(tmp_path: Path) -> None:
    path = tmp_path / "scene.obj"
    path.write_bytes(bytes(range(60)))
    with pytest.raises(LoadError, match=r"no known format, expected PLY \(\.ply\)"):
        io.load(path)


def test_what_is_no_file_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "empty.ply").touch()
    os.mkfifo(tmp_path / "pipe.ply")
    for name, message in {
        "missing.ply": "cannot be read: No such file or directory; check the path",
        "": "empty.ply: at byte 0: is empty",  # of a folder, the one file in it
        "pipe.ply": "is a device or a pipe",
        "empty.ply": "is empty",
        "empty.ply/inside": "cannot be read: Not a directory",
    }.items():
        with pytest.raises(LoadError, match=message) as caught:
            io.load(tmp_path / name)
        assert "\n" not in str(caught.value)


def test_a_file_that_may_not_be_read_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "scene.ply"
    path.write_bytes(ply_bytes([splats([one_splat()])]))

    def forbidden(*_: object) -> None:
        raise PermissionError(13, "Permission denied")  # root may read every file, so it is only said

    monkeypatch.setattr(Path, "open", forbidden)
    with pytest.raises(LoadError, match="cannot be read: Permission denied"):
        io.load(path)


def test_a_scene_too_large_for_memory_says_how_to_keep_less(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "scene.ply"
    path.write_bytes(ply_bytes([splats([one_splat()])]))

    def no_memory(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr("tsplat.io.ply_decode.Decoder.gather", no_memory)
    with pytest.raises(LoadError, match="max_splats"):
        io.load(path)


@pytest.mark.parametrize("limit", [0, -1])
def test_a_limit_below_one_is_refused(limit: int) -> None:
    with pytest.raises(OptionError, match="max_splats must be 1 or more"):
        io.load(io.demo_path(), max_splats=limit)


@pytest.mark.parametrize("limit", [None, 100])
def test_progress_grows_to_one(limit: int | None) -> None:
    seen: list[float] = []
    io.load(io.demo_path(), max_splats=limit, progress=seen.append)
    assert len(seen) > 10
    assert seen == sorted(seen)
    assert 0.0 < seen[0] < 0.5
    assert seen[-1] == 1.0


def test_saving_replaces_a_file_and_leaves_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "scene.ply"
    path.write_bytes(b"old")
    assert io.save(str(path), SCENE) == path
    assert len(io.load(path)) == 3
    assert list(tmp_path.iterdir()) == [path]


def test_a_write_that_fails_keeps_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "scene.ply"
    path.write_bytes(b"old")

    def disk_full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "log", disk_full)
    with pytest.raises(SaveError, match="No space left on device; choose another folder"):
        io.save(path, SCENE)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("name", "message"), [("scene.gif", "suffix '.gif'.*use one of .ply"), ("no/folder.ply", "No such file")]
)
def test_a_scene_that_cannot_be_written_is_a_save_error(tmp_path: Path, name: str, message: str) -> None:
    with pytest.raises(SaveError, match=message):
        io.save(tmp_path / name, SCENE)


def test_the_demo_is_small_enough_to_ship_and_names_its_author() -> None:
    gaussians = io.load(io.demo_path())
    assert (len(gaussians), gaussians.sh_degree) == (125_000, 1)
    assert len(zlib.compress(io.demo_path().read_bytes(), 6)) < 4_500_000
    credit = io.demo_path().with_suffix(".txt").read_text()
    for words in ("PLAYBOT", "Stephane Agullo", "https://superspl.at/view?id=ee6d8bc4", "CC-BY-4.0", "Changes:"):
        assert words in credit
