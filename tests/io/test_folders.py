"""Scenes in folders and in zips: the one that is meant is opened, several are listed, nothing leaves its place."""

from __future__ import annotations

import gzip
import json
import os
import stat
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.io.plys import one_splat, ply_bytes, splats
from tests.io.sogs import made_up, zipped
from tests.io.test_sources import piped
from tests.scenes import random_gaussians
from tsplat import io
from tsplat.errors import CorruptFileError, LoadError, LoadWarning
from tsplat.io.candidates import find_series
from tsplat.io.folders import is_whole
from tsplat.io.train_focal import training_beside
from tsplat.io.unpack import MOST_TIMES, SLACK

Files = dict[str, bytes]


@pytest.fixture(autouse=True)
def _nothing_stays(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    folder = tmp_path_factory.mktemp("temporary")
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    yield
    assert list(folder.iterdir()) == []


def ply(count: int) -> bytes:
    """Return a scene that is known by its number of splats."""
    return ply_bytes([splats([one_splat(x=float(each)) for each in range(count)])])


def saved(suffix: str, count: int) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        scene = random_gaussians(np.random.default_rng(1), count, 0)
        return io.save(Path(folder) / f"scene{suffix}", scene).read_bytes()


def sog(count: int, folder: str = "") -> Files:
    files = made_up(np.random.default_rng(2), count).files()
    return {f"{folder}{name}": content for name, content in files.items()}


STEPS = "point_cloud/iteration_{}/point_cloud.ply"
MEANT = 5
"""How many splats the scene has that is meant."""

PLACES: dict[str, Files] = {
    "one file": {"scene.ply": ply(MEANT), "README.md": b"words", "thumbnail.jpg": b"\xff\xd8\xff"},
    "a training": {
        STEPS.format(7000): ply(3), STEPS.format(30000): ply(MEANT), "input.ply": ply(9),
        "cameras.json": b"[]", "cfg_args": b"Namespace()",
    },
    "a training by number, not by name": {STEPS.format(9000): ply(3), STEPS.format(30000): ply(MEANT)},
    "gsplat": {
        "ply/point_cloud_6999.ply": ply(3), "ply/point_cloud_29999.ply": ply(MEANT),
        "ckpts/ckpt_29999_rank0.pt": zipped({"archive/data.pkl": b""}), "cfg.yml": b"", "videos/traj.mp4": b"",
        **sog(7, "compression/rank0/"),
    },
    "brush": {"export_5000.ply": ply(3), "export_30000.ply": ply(MEANT)},
    "nerfstudio": {
        "config.yml": b"", "exports/splat/splat.ply": ply(MEANT), "sparse_pc.ply": ply(2),
        "nerfstudio_models/step-000029999.ckpt": zipped({"archive/data.pkl": b""}),
    },
    "first points alone": {"input.ply": ply(MEANT)},
    "a SOG": sog(MEANT),
    "a SOG below": sog(MEANT, "capture/"),
    "a zipped SOG": {"a/scene.sog": made_up(np.random.default_rng(2), MEANT).zipped()},
    "a splat": {"scene.splat": saved(".splat", MEANT)},
    "packed once more": {"a/scene.ply.gz": gzip.compress(ply(MEANT))},
    "what systems leave": {"__MACOSX/._scene.ply": b"x", ".trash/old.ply": ply(2), "a/scene.ply": ply(MEANT)},
    "a meta.json of something else": {"meta.json": b'{"author": "me"}', "scene.ply": ply(MEANT)},
    "nearest to the top": {"scene.ply": ply(MEANT), "old/other.ply": ply(2), "old/more.ply": ply(3)},
}  # fmt: skip


def unpacked(folder: Path, files: Files) -> Path:
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return folder


def packed(tmp_path: Path, files: Files, kind: int = zipfile.ZIP_STORED) -> Path:
    path = tmp_path / "capture.zip"
    path.write_bytes(zipped(files, kind))
    return path


@pytest.mark.parametrize("place", PLACES)
def test_the_one_scene_that_is_meant_is_opened(tmp_path: Path, place: str) -> None:
    files = PLACES[place]
    folder = unpacked(tmp_path / "capture", files)
    assert len(io.load(folder)) == MEANT
    assert len(io.load(f"{folder}/")) == MEANT
    for kind in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        assert len(io.load(packed(tmp_path, files, kind))) == MEANT
    below = {f"downloaded/capture/{name}": content for name, content in files.items()}
    assert len(io.load(packed(tmp_path, below))) == MEANT
    assert len(io.load(unpacked(tmp_path / "above", below))) == MEANT


def test_a_training_that_was_stopped_gives_its_newest_whole_scene_and_says_so(tmp_path: Path) -> None:
    steps = {7000: ply(4), 15000: ply(5)[:-1], 20000: b"", 30000: ply(6)[:40]}
    files = {STEPS.format(step): content for step, content in steps.items()}
    for place in (unpacked(tmp_path / "model", files), packed(tmp_path, files)):
        with pytest.warns(
            LoadWarning, match=r"iteration_7000/.*was opened, as what is newer is not whole"
        ) as caught:
            assert len(io.load(place)) == 4
        said = str(caught[0].message)
        assert all(f"iteration_{step}" in said for step in (30000, 20000, 15000))
        assert said.startswith(str(place)), "the place is called what it was called"


@pytest.mark.parametrize("suffix", [".ply", ".compressed.ply", ".splat", ".sog", ".glb"])
def test_a_scene_of_which_the_end_is_missing_is_not_whole(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"scene{suffix}"
    path.write_bytes(saved(suffix, 30))
    assert is_whole(path)
    path.write_bytes(path.read_bytes()[:-30])
    assert not is_whole(path)


def test_where_nothing_is_whole_the_newest_says_what_is_wrong(tmp_path: Path) -> None:
    files = {STEPS.format(7000): ply(4)[:-1], STEPS.format(30000): ply(5)[:-1]}
    for place in (unpacked(tmp_path / "model", files), packed(tmp_path, files)):
        with pytest.raises(CorruptFileError, match=r"iteration_30000.point_cloud\.ply: .*fetch it again"):
            io.load(place)


NONE: dict[str, tuple[Files, str]] = {
    "two": ({"a.ply": ply(1), "b.ply": ply(1)}, r"holds 2 scenes: 'a\.ply', 'b\.ply'; .*name one of them"),
    "two of a name": ({"room1.ply": ply(1), "room2.ply": ply(1)}, "holds 2 scenes"),
    "many": ({f"{each:02}.ply": ply(1) for each in range(30)}, r"'07\.ply' and 22 more; "),
    "none": ({"a.txt": b"x", "b/c.txt": b"y"}, "holds no scene among its 2 files"),
    "a checkpoint": (
        {"ckpts/ckpt_6999_rank0.pt": b"", "ckpts/ckpt_29999_rank0.pt": b""},
        "holds no scene; 'ckpts/ckpt_29999_rank0.pt' in it is a PyTorch checkpoint.*numpy.savez",
    ),
}


@pytest.mark.parametrize("place", NONE)
def test_several_scenes_are_listed_and_none_is_said(tmp_path: Path, place: str) -> None:
    files, problem = NONE[place]
    for path in (unpacked(tmp_path / "capture", files), packed(tmp_path, files)):
        with pytest.raises(LoadError, match=problem) as caught:
            io.load(path)
        assert str(caught.value).isprintable()


def test_cameras_of_a_training_are_found_where_its_folder_is_given(tmp_path: Path) -> None:
    folder = unpacked(tmp_path / "model", PLACES["a training"])
    camera = {
        "width": 100,
        "height": 80,
        "fx": 90,
        "fy": 90,
        "rotation": np.eye(3).tolist(),
        "position": [0, 0, 0],
    }
    (folder / "cameras.json").write_text(json.dumps([camera]))
    training = training_beside(folder)
    assert training.focal == 90
    assert training.views is not None


def test_links_are_not_followed_into_circles_nor_pipes_opened(tmp_path: Path) -> None:
    folder = unpacked(tmp_path / "capture", {"a/b/scene.ply": ply(MEANT)})
    (folder / "a" / "again").symlink_to(folder)
    os.mkfifo(folder / "pipe.ply")
    assert len(io.load(folder)) == MEANT


def test_a_folder_that_may_not_be_read_hides_no_scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = unpacked(tmp_path / "capture", {"locked/x": b"", "open/scene.ply": ply(MEANT)})
    scandir = os.scandir

    def guarded(path: Path) -> Iterator[os.DirEntry[str]]:
        if path.name == "locked":
            raise PermissionError(13, "Permission denied")  # root may read every folder, so it is only said
        return scandir(path)

    monkeypatch.setattr(os, "scandir", guarded)
    assert len(io.load(folder)) == MEANT
    with pytest.raises(LoadError, match="locked: cannot be read: Permission denied"):
        io.load(folder / "locked")


def test_a_folder_that_is_too_deep_or_too_large_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = unpacked(tmp_path / "deep", {"1/2/3/4/5/scene.ply": ply(1)})
    with pytest.raises(LoadError, match="holds no scene among its 0 files"):
        io.load(folder)
    monkeypatch.setattr("tsplat.io.folders.MOST_FILES", 9)
    folder = unpacked(tmp_path / "large", {**{f"{each}.txt": b"" for each in range(20)}, "a/scene.ply": ply(1)})
    with pytest.raises(LoadError, match="holds no scene among its"):
        io.load(folder)


@pytest.mark.parametrize(
    "name", ["../out.ply", "/out.ply", "a/../../out.ply", "C:/out.ply", "..\\out.ply", "a\x1b[2J.ply"]
)
def test_a_zip_writes_nothing_outside_of_its_place(tmp_path: Path, name: str) -> None:
    with pytest.raises(LoadError, match="holds only files whose names lead out of it"):
        io.load(packed(tmp_path, {name: ply(1)}))
    assert len(io.load(packed(tmp_path, {name: ply(1), "scene.ply": ply(MEANT)}))) == MEANT
    assert sorted(path.name for path in tmp_path.iterdir()) == ["capture.zip"]


def test_backslashes_in_the_names_of_a_zip_part_folders(tmp_path: Path) -> None:
    files = {name.replace("/", "\\"): content for name, content in sog(MEANT, "a/b/").items()}
    assert len(io.load(packed(tmp_path, files))) == MEANT


def test_a_link_in_a_zip_is_a_file_of_words(tmp_path: Path) -> None:
    path = tmp_path / "capture.zip"
    with zipfile.ZipFile(path, "w") as archive:
        link = zipfile.ZipInfo("scene.ply")
        link.external_attr = (stat.S_IFLNK | 0o777) << 16
        archive.writestr(link, "/etc/passwd")
    with pytest.raises(LoadError, match=r"capture\.zip.scene\.ply: is text, not the scene itself: '/etc/passwd'"):
        io.load(path)


def test_a_zip_that_unpacks_to_too_much_is_refused_before_it_fills_the_disk(tmp_path: Path) -> None:
    bomb = {"scene.ply": bytes(SLACK + 3 * MOST_TIMES * 10_000)}
    with pytest.raises(CorruptFileError, match=f"'scene.ply' unpacks to more than {MOST_TIMES} times"):
        io.load(packed(tmp_path, bomb, zipfile.ZIP_DEFLATED))
    many = {f"a/{each}.bin": bytes(SLACK // 8) for each in range(16)} | {"a/scene.gltf": b"{}"}
    with pytest.raises(CorruptFileError, match="unpacks to more than"):
        io.load(packed(tmp_path, many, zipfile.ZIP_DEFLATED))


def test_zips_in_zips_stay_closed(tmp_path: Path) -> None:
    with pytest.raises(LoadError, match="holds zips, which are not looked into; unpack it first"):
        io.load(packed(tmp_path, {"inner.zip": zipped({"scene.ply": ply(1)})}))


def test_a_zip_of_which_a_byte_changed_is_refused(tmp_path: Path) -> None:
    path = packed(tmp_path, {"scene.ply": ply(MEANT)})
    content = bytearray(path.read_bytes())
    content[400] ^= 1
    path.write_bytes(content)
    with pytest.raises(CorruptFileError, match=r"'scene\.ply' cannot be unpacked, expected contents that fit"):
        io.load(path)


def test_a_zip_cut_anywhere_is_refused(tmp_path: Path) -> None:
    path = packed(tmp_path, {"scene.ply": ply(1)})
    content = path.read_bytes()
    for length in range(0, len(content), 7):
        path.write_bytes(content[:length])
        with pytest.raises(LoadError, match=r"capture\.zip"):
            io.load(path)


def test_frames_that_are_numbered_are_scenes_of_their_own() -> None:
    assert len(find_series(["frame_001.ply", "frame_002.ply"])) == 2
    assert [series.names for series in find_series(["splat_2000.ply", "splat_10000.ply"])] == [
        ["splat_10000.ply", "splat_2000.ply"]
    ]
    assert find_series([]) == []


def test_first_points_of_a_training_are_one_scene_in_whichever_file() -> None:
    names = ["sparse/0/points3D.bin", "sparse/0/points3D.txt", "sparse/0/cameras.bin", "sparse/0/images.txt"]
    assert [series.names[0] for series in find_series(names)] == ["sparse/0/points3D.bin"]
    assert [series.names[0] for series in find_series([*names, "sparse/0/points3D.ply"])] == [
        "sparse/0/points3D.ply"
    ]
    assert [series.names for series in find_series([*names, "a/b/c/scene.ply"])] == [["a/b/c/scene.ply"]]


def test_a_zip_through_a_pipe_is_opened_too() -> None:
    with piped(zipped({"a/scene.ply": ply(MEANT)})):
        assert len(io.load("-")) == MEANT
    broken = zipped({"a/scene.ply": ply(MEANT)[:-1]})
    with piped(broken), pytest.raises(LoadError, match=r"standard input/a/scene\.ply: "):
        io.load("-")
