"""Scenes from standard input and in gzip: the same as from a file, and nothing stays behind."""

from __future__ import annotations

import errno
import gzip
import json
import os
import pty
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest

from tests.io.ksplats import gaussforge
from tests.io.plys import one_splat, ply_bytes, splats
from tests.io.sogs import made_up
from tests.io.spzs import Splat, bare, zipped
from tests.scenes import random_gaussians
from tsplat import cli, io
from tsplat.errors import CorruptFileError, LoadError, LoadWarning
from tsplat.io import sources, unpack
from tsplat.io.sources import file_name
from tsplat.io.unpack import MOST_TIMES, SLACK
from tsplat.scene import Gaussians

SCENE = random_gaussians(np.random.default_rng(5), 40, 1)


@pytest.fixture(autouse=True)
def _nothing_stays(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    folder = tmp_path_factory.mktemp("temporary")
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    yield
    assert list(folder.iterdir()) == []


@contextmanager
def standard_input(end: int) -> Iterator[None]:
    """Let standard input be this open file."""
    before = os.dup(0)
    os.dup2(end, 0)
    try:
        yield
    finally:
        os.dup2(before, 0)
        os.close(before)


@contextmanager
def piped(content: bytes) -> Iterator[None]:
    """Let standard input be a pipe that brings these bytes."""
    read_end, write_end = os.pipe()

    def bring() -> None:
        with os.fdopen(write_end, "wb") as file:
            file.write(content)

    writer = threading.Thread(target=bring)
    writer.start()
    with standard_input(read_end):
        yield
    writer.join()
    os.close(read_end)


@contextmanager
def piped_forever(content: bytes) -> Iterator[None]:
    """Let standard input be a pipe that brings these bytes again and again, until nobody reads them."""
    read_end, write_end = os.pipe()

    def bring() -> None:
        with suppress(BrokenPipeError), os.fdopen(write_end, "wb", buffering=0) as file:
            while True:
                file.write(content)

    writer = threading.Thread(target=bring)
    writer.start()
    with standard_input(read_end):
        os.close(read_end)
        yield
    writer.join()


def scene_bytes(folder: Path, suffix: str) -> bytes:
    if suffix == ".sog":
        return made_up(np.random.default_rng(6)).zipped()
    path = io.save(folder / f"saved{suffix}", SCENE)
    return path.read_bytes()


def same(one: Gaussians, other: Gaussians) -> bool:
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in ("means", "sh", "opacities"))


@pytest.mark.parametrize("suffix", [".ply", ".compressed.ply", ".splat", ".spz", ".sog"])
@pytest.mark.filterwarnings("ignore::tsplat.errors.SaveWarning")  # a .splat has no harmonics
def test_a_packed_scene_is_the_scene(tmp_path: Path, suffix: str) -> None:
    content = scene_bytes(tmp_path, suffix)
    plain, packed = tmp_path / f"scene{suffix}", tmp_path / f"scene{suffix}.GZ"
    plain.write_bytes(content)
    packed.write_bytes(gzip.compress(content))
    assert same(io.load(plain), io.load(packed))


@pytest.mark.parametrize("suffix", [".ply", ".compressed.ply", ".spz", ".sog", ".splat", ".gltf", ".glb"])
@pytest.mark.parametrize("pack", [bytes, gzip.compress])
@pytest.mark.filterwarnings("ignore::tsplat.errors.SaveWarning")  # a .splat has no harmonics
def test_a_piped_scene_is_the_scene(tmp_path: Path, suffix: str, pack: Callable[[bytes], bytes]) -> None:
    content = scene_bytes(tmp_path, suffix)
    plain = tmp_path / f"scene{suffix}"
    plain.write_bytes(content)
    with piped(pack(content)):
        assert same(io.load(plain), io.load("-"))


@pytest.mark.filterwarnings("ignore::tsplat.errors.SaveWarning")  # a .splat has no harmonics
def test_a_packed_scene_needs_no_suffix_that_says_so(tmp_path: Path) -> None:
    path = tmp_path / "scene.splat"
    path.write_bytes(gzip.compress(scene_bytes(tmp_path, ".splat")))
    assert len(io.load(path)) == len(SCENE)


def test_members_behind_each_other_are_one_file(tmp_path: Path) -> None:
    content = scene_bytes(tmp_path, ".ply")
    path = tmp_path / "scene.ply.gz"
    path.write_bytes(gzip.compress(content[:500]) + gzip.compress(content[500:]) + bytes(7))
    assert len(io.load(path)) == len(SCENE)


def test_an_spz_is_read_as_it_is_though_it_is_gzip(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "scene.gz"
    path.write_bytes(scene_bytes(tmp_path, ".spz"))
    monkeypatch.setattr(sources, "unpack", None)
    assert len(io.load(path)) == len(SCENE)


@pytest.mark.parametrize("content", [b"\0", b"no scene"])
def test_what_is_piped_or_packed_without_end_and_is_no_scene_is_given_up_soon(
    tmp_path: Path, content: bytes
) -> None:
    path = tmp_path / "scene.ply.gz"
    path.write_bytes(gzip.compress(content * (1 << 22)))
    with pytest.raises(LoadError, match=r"scene\.ply\.gz: (at byte 0: begins with .*, expected 'ply'|is text)"):
        io.load(path)
    with (
        piped_forever(content * (1 << 16)),
        pytest.raises(LoadError, match=r"standard input: (at byte 0: |is text)"),
    ):
        io.load("-")


def test_only_one_layer_is_unpacked(tmp_path: Path) -> None:
    path = tmp_path / "scene.ply.gz.gz"
    path.write_bytes(gzip.compress(gzip.compress(ply_bytes([splats([one_splat()])]))))
    with pytest.raises(LoadError, match=r"scene\.ply\.gz\.gz: at byte 0: is of no known format"):
        io.load(path)


def test_a_packed_scene_that_ends_early_says_so(tmp_path: Path) -> None:
    whole = gzip.compress(scene_bytes(tmp_path, ".ply"))
    path = tmp_path / "scene.ply.gz"
    for length in (3, 9, 10, 12, 40, 500, len(whole) - 8, len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(
            CorruptFileError, match=r"scene\.ply\.gz: at byte \d+: does not unpack: .*fetch it again$"
        ):
            io.load(path)


@pytest.mark.parametrize("place", [0.1, 0.5, -6, -2])
def test_a_packed_scene_with_a_wrong_byte_says_so(tmp_path: Path, place: float) -> None:
    content = bytearray(gzip.compress(scene_bytes(tmp_path, ".ply")))
    content[int(place * len(content)) if place > 0 else int(place)] ^= 0x55
    path = tmp_path / "scene.ply.gz"
    path.write_bytes(content)
    with pytest.raises(CorruptFileError, match=r"scene\.ply\.gz: "):
        io.load(path)


def test_what_was_made_to_fill_a_disk_is_given_up_soon(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "scene.ply.gz"
    path.write_bytes(gzip.compress(ply_bytes([splats([one_splat()])]) + bytes(1 << 26)))
    sizes: list[int] = []

    def unpacked(packed: Path, place: Path, progress: Callable[[float], None]) -> None:
        try:
            unpack.unpack(packed, place, progress)
        finally:
            sizes.append(place.stat().st_size)

    monkeypatch.setattr(sources, "unpack", unpacked)
    with pytest.raises(CorruptFileError, match="unpacks to more than 100 times"):
        io.load(path)
    assert sizes[0] <= MOST_TIMES * path.stat().st_size + SLACK
    with piped(path.read_bytes()), pytest.raises(CorruptFileError, match="standard input: unpacks to more than"):
        io.load("-")


def test_zeros_that_pack_well_are_no_bomb(tmp_path: Path) -> None:
    path = tmp_path / "scene.ply.gz"
    path.write_bytes(gzip.compress(ply_bytes([splats([one_splat()])]) + bytes(SLACK - 4096)))
    assert len(io.load(path)) == 1


def test_an_error_names_what_a_person_named(tmp_path: Path) -> None:
    broken = ply_bytes([splats([one_splat()])])[:-3]
    path = tmp_path / "cut.ply.gz"
    path.write_bytes(gzip.compress(broken))
    with pytest.raises(CorruptFileError) as caught:
        io.load(path)
    assert str(caught.value).startswith(f"{path}: at byte ")
    assert caught.value.path == path
    with piped(broken), pytest.raises(CorruptFileError, match=r"^standard input: at byte"):
        io.load("-")


def test_a_warning_names_what_a_person_named(tmp_path: Path) -> None:
    path = tmp_path / "dropped.ply.gz"
    path.write_bytes(gzip.compress(ply_bytes([splats([one_splat(), one_splat(x=np.nan)])])))
    with pytest.warns(LoadWarning) as caught:
        assert len(io.load(path)) == 1
    assert str(caught[0].message).startswith(f"{path}: dropped 1 of 2")


def test_files_beside_a_piped_json_are_missed_in_one_line() -> None:
    meta = made_up(np.random.default_rng(6)).files()["meta.json"]
    with piped(meta), pytest.raises(CorruptFileError, match=r"^standard input/means_l\.webp: is missing"):
        io.load("-")


def test_a_terminal_as_standard_input_is_no_scene() -> None:
    master, slave = pty.openpty()
    try:
        with standard_input(slave), pytest.raises(LoadError, match="standard input: is the keyboard"):
            io.load("-")
    finally:
        os.close(master)
        os.close(slave)


def test_an_empty_pipe_is_an_empty_file() -> None:
    with piped(b""), pytest.raises(LoadError, match="standard input: at byte 0: is empty"):
        io.load("-")


def test_a_path_is_never_standard_input(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("-").write_bytes(ply_bytes([splats([one_splat()])]))
    assert len(io.load(Path("-"))) == len(io.load("./-")) == 1


def test_a_full_disk_is_one_line_that_says_where(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "scene.ply.gz"
    path.write_bytes(gzip.compress(b"ply\n"))

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(sources, "unpack", full)
    with pytest.raises(
        LoadError, match=r"scene\.ply\.gz: finds no room in .*: No space left on device; set TMPDIR"
    ):
        io.load(path)


@pytest.mark.parametrize("known", [True, False])
def test_progress_grows_to_one_and_bytes_are_told(known: bool) -> None:
    content = io.demo_path().read_bytes()
    fractions: list[float] = []
    told: list[tuple[int, int | None]] = []

    def load() -> None:
        io.load("-", progress=fractions.append, fetched=lambda done, size: told.append((done, size)))

    if known:
        with io.demo_path().open("rb") as file, standard_input(file.fileno()):
            load()
    else:
        with piped(content):
            load()
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    assert (fractions[0] < 0.5) == known
    assert told == sorted(told)
    assert told[-1] == (len(content), len(content) if known else None)


@pytest.mark.parametrize(
    ("source", "name"),
    [
        ("-", "stdin"),
        ("a/b/scene.ply", "scene.ply"),
        ("a/scene.ply.gz", "scene.ply"),
        ("https://host/x/scene.spz", "scene.spz"),
        ("https://host/x/scene.spz?sig=a/b.ply#c/d", "scene.spz"),
        ("https://host/x/my%20scene.ply.GZ", "my scene.ply"),
        ("https://host/x/..%2f..%2fetc%2fpasswd.ply", ".._.._etc_passwd.ply"),
        ("https://host/%2e%2e", "scene"),
        ("https://host/x/%2e%2e?a", "scene"),
        ("https://host", "host"),
        ("https://host/", "host"),
        ("https://host/a%00b%1b[2J.ply", "a_b_[2J.ply"),
        (r"https://host/..\..\c:x.ply", ".._.._c_x.ply"),
        ("s3://bucket/folder/scene#1.sog", "scene#1.sog"),
        ("https://host/" + "n" * 300 + ".splat", "n" * 54 + ".splat"),
        ("https://host/" + "%F0%9F%98%80" * 300 + ".splat", "\N{GRINNING FACE}" * 54 + ".splat"),
    ],
)
def test_names_of_what_comes_from_elsewhere_stay_in_their_folder(tmp_path: Path, source: str, name: str) -> None:
    assert file_name(source) == name
    (tmp_path / name).touch()
    assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize("source", ["-", "https://host/scene.ply", "s3://bucket/scene.ply"])
def test_cameras_in_the_current_folder_belong_to_no_scene_from_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, source: str
) -> None:
    camera = {"position": [0, 0, 0], "rotation": np.eye(3).tolist(), "width": 8, "height": 6, "fx": 7, "fy": 7}
    (tmp_path / "cameras.json").write_text(json.dumps([camera]))
    monkeypatch.chdir(tmp_path)
    assert io.train_focal_beside("scene.ply.gz") == 7
    assert io.train_focal_beside(source) is None


def test_a_file_costs_no_copy_and_no_network_library(tmp_path: Path) -> None:
    path = tmp_path / "scene.ply"
    path.write_bytes(ply_bytes([splats([one_splat()])]))
    code = (
        "import sys, tsplat, tsplat.temporary as t; t.TemporaryFolder.__init__ = None; tsplat.load(sys.argv[1]);"
        "print([name for name in ('fsspec', 'aiohttp', 'asyncio.events') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code, path], capture_output=True, timeout=120, check=True)
    assert done.stdout.decode().strip() == "[]"


def test_an_spz_that_was_packed_once_more_is_an_spz(tmp_path: Path) -> None:
    path = tmp_path / "scene.gz"
    path.write_bytes(gzip.compress(zipped(bare([Splat((1, 2, 3), quat=(3, 0, 0, 0))], 3, 0))))
    assert len(io.load(path)) == 1


def test_a_format_that_is_asked_for_on_the_command_line_is_brought_to_its_end(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sources, "PIECE_BYTES", 1024)  # of more, what is no scene by its first bytes is given up
    with piped(gaussforge(random_gaussians(np.random.default_rng(1), 40, 0))):
        assert cli.main(["info", "-", "--format", "ksplat", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["splats"] == 40
