"""Scenes at URLs: the same as from a file, and one line for everything that goes wrong on the way."""

from __future__ import annotations

import asyncio
import gzip
import json
import os
import pickle
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from urllib.parse import quote

import numpy as np
import pytest

from tests.io.gltfs import scene_of
from tests.io.honest_files import HONEST
from tests.io.plys import one_splat, ply_bytes, splats
from tests.io.servers import Server
from tests.io.sogs import made_up
from tests.scenes import random_gaussians
from tsplat import cli, io
from tsplat.errors import CorruptFileError, LoadError, LoadWarning, OptionError
from tsplat.io import arrival, remote, remote_errors
from tsplat.io.sog_beside import Beside

PLY = ply_bytes([splats([one_splat()])])


@pytest.fixture(autouse=True)
def _no_proxy(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def temporary(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder for temporary files, in which nothing else is."""
    folder = tmp_path_factory.mktemp("temporary")
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


@pytest.fixture
def server(temporary: Path) -> Iterator[Server]:
    with Server({}) as running:
        yield running
    assert list(temporary.iterdir()) == []


def folder_files(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def streamed_scene(folder: Path) -> None:
    """Write a lod-meta.json, its fine level in a folder of planes, its coarse one in a zip."""
    fine, coarse = made_up(np.random.default_rng(2)), made_up(np.random.default_rng(3), bands=0)
    (folder / "fine").mkdir()
    for name, content in fine.files().items():
        (folder / "fine" / name).write_bytes(content)
    (folder / "coarse #1.sog").write_bytes(coarse.zipped())
    lods = {"0": {"file": 0, "offset": 1, "count": 5}, "1": {"file": 1, "offset": 0, "count": 2}}
    tree = {"lodLevels": 2, "filenames": ["fine/meta.json", "coarse #1.sog"], "tree": {"lods": lods}}
    (folder / "lod-meta.json").write_text(json.dumps(tree))


@pytest.mark.parametrize("how", ["plain", "endless"])
@pytest.mark.parametrize("suffix", [".ply", ".compressed.ply", ".splat", ".spz"])
@pytest.mark.filterwarnings("ignore::tsplat.errors.SaveWarning")  # a .splat has no harmonics
def test_a_fetched_scene_is_the_scene(server: Server, tmp_path: Path, suffix: str, how: str) -> None:
    path = io.save(tmp_path / f"scene{suffix}", random_gaussians(np.random.default_rng(5), 3000, 1))
    server.files = {f"my%20{path.name}": path.read_bytes()}
    fractions: list[float] = []
    told: list[tuple[int, int | None]] = []
    fetched = io.load(
        server.url(how, f"my%20{path.name}?a=b"),
        progress=fractions.append,
        fetched=lambda done, size: told.append((done, size)),
    )
    assert np.array_equal(fetched.means, io.load(path).means)
    size = path.stat().st_size
    assert (told[0], told[-1]) == ((0, None), (size, size if how == "plain" else None))
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0


@pytest.mark.parametrize("name", ["scene.ply.gz", "scene.ply"])
@pytest.mark.parametrize("how", ["plain", "packed"])
def test_a_scene_that_comes_packed_is_unpacked_once(server: Server, name: str, how: str) -> None:
    server.files = {name: gzip.compress(PLY)}
    assert len(io.load(server.url(how, name))) == 1
    server.files = {name: gzip.compress(PLY + bytes(1 << 26))}
    with pytest.raises(CorruptFileError, match=rf"{name}: unpacks to more than 100 times"):
        io.load(server.url(how, name))


def test_a_json_brings_along_the_planes_it_names_and_nothing_else(server: Server, tmp_path: Path) -> None:
    files = made_up(np.random.default_rng(1)).files()
    server.files = {f"x/{name}": content for name, content in files.items()} | {"x/other.webp": b"", "x/0": b""}
    fractions: list[float] = []
    fetched = io.load(server.url("plain", "x/meta.json?sig=1"), progress=fractions.append)
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    assert np.array_equal(fetched.sh, io.load(tmp_path / "meta.json").sh)
    assert sorted(server.asked) == sorted(f"x/{name}" for name in files)
    assert fractions == sorted(fractions)
    assert sum(0.05 < fraction < 0.7 for fraction in fractions) >= 5  # a part of the bar for each plane


def test_a_folder_of_gsplat_and_a_zip_come_from_their_addresses(server: Server, tmp_path: Path) -> None:
    honest = {**HONEST["gsplat PNG"], **HONEST["PLY in a zip"]}
    for name, content in honest.items():
        (tmp_path / name).write_bytes(content)
    server.files = {f"x/{name}": content for name, content in honest.items()}
    for name in ("meta.json", "scene.zip"):
        fetched = io.load(server.url("plain", f"x/{name}"))
        assert np.array_equal(fetched.means, io.load(tmp_path / name).means)
    assert sorted(server.asked) == sorted(f"x/{name}" for name in honest)


@pytest.mark.parametrize("suffix", [".splat", ".gltf", ".spz"])
@pytest.mark.parametrize("address", ["download", "download?id=7&file=a.bin", "d.php"])
@pytest.mark.filterwarnings("ignore::tsplat.errors.SaveWarning")  # a .splat has no harmonics
def test_an_address_without_a_suffix_brings_what_it_holds(
    server: Server, tmp_path: Path, suffix: str, address: str
) -> None:
    path = io.save(tmp_path / f"scene{suffix}", random_gaussians(np.random.default_rng(5), 30, 1))
    server.files = {address.partition("?")[0]: path.read_bytes()}
    assert np.array_equal(io.load(server.url("plain", address)).means, io.load(path).means)


@pytest.mark.parametrize("lod", [0, 1, None])
def test_of_a_streamed_scene_only_the_level_asked_for_comes(
    server: Server, tmp_path: Path, lod: int | None
) -> None:
    streamed_scene(tmp_path)
    server.files = {quote(name): content for name, content in folder_files(tmp_path).items()}
    fetched = io.load(server.url("plain", "lod-meta.json"), lod=lod)
    assert np.array_equal(fetched.means, io.load(tmp_path / "lod-meta.json", lod=lod).means)
    assert ("coarse%20%231.sog" in server.asked) == (lod != 0)
    assert ("fine/means_l.webp" in server.asked) == (lod != 1)
    with pytest.raises(OptionError, match="lod must be 0 to 1"):
        io.load(server.url("plain", "lod-meta.json"), lod=2)


@pytest.mark.parametrize("name", ["../secret.webp", "/etc/passwd", r"..\secret.webp", "a/../../secret.webp", ""])
def test_names_that_lead_out_of_the_folder_are_not_asked_for(server: Server, name: str) -> None:
    scene = made_up(np.random.default_rng(1))
    scene.meta["scales"]["files"] = [name]
    server.files = {"x/meta.json": scene.files()["meta.json"]}
    with pytest.raises(CorruptFileError, match=r"x/meta\.json: field scales\.files"):
        io.load(server.url("plain", "x/meta.json"))
    lods = {"lods": {"0": {"file": 0, "offset": 0, "count": 1}}}
    tree = {"lodLevels": 1, "filenames": [name], "tree": lods}
    server.files = {"x/meta.json": json.dumps(tree).encode()}
    with pytest.raises(CorruptFileError, match=r"x/meta\.json: field filenames"):
        io.load(server.url("plain", "x/meta.json"))
    assert server.asked == ["x/meta.json", "x/meta.json"]


def test_a_json_that_names_itself_is_fetched_once(server: Server) -> None:
    lods = {"lods": {"0": {"file": 0, "offset": 0, "count": 1}}}
    tree = {"lodLevels": 1, "filenames": ["lod-meta.json"], "tree": lods}
    server.files = {"lod-meta.json": json.dumps(tree).encode()}
    with pytest.raises(CorruptFileError, match="field means is missing"):
        io.load(server.url("plain", "lod-meta.json"))
    assert server.asked == ["lod-meta.json"]


def test_a_file_of_which_half_came_is_fetched_again_when_it_is_asked_for_again(tmp_path: Path) -> None:
    broken = [True, False]

    def fetch(url: str, place: Path, _: object) -> None:
        place.write_text(f"half of {url}")
        if broken.pop(0):
            raise LoadError(url, "was cut off")
        place.write_text("all")

    beside = Beside(tmp_path, str, fetch)
    with pytest.raises(LoadError, match="cut off"):
        beside.bring("x.webp", lambda _: None)
    assert beside.bring("x.webp", lambda _: None).read_text() == "all"
    assert beside.bring("x.webp", lambda _: None).read_text() == "all"  # not fetched a third time


def test_a_gltf_is_not_taken_for_json_of_planes(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tsplat.io.sog_json.JSON_BYTES", 100)
    server.files = {"scene.gltf": scene_of(random_gaussians(np.random.default_rng(1), 5, 1)).gltf()}
    assert len(io.load(server.url("plain", "scene.gltf"))) == 5


def test_a_plane_that_is_not_there_is_named_by_its_address(server: Server) -> None:
    files = made_up(np.random.default_rng(1)).files()
    del files["quats.webp"]
    server.files = files
    url = server.url("plain", "quats.webp")
    with pytest.raises(LoadError, match=rf"^{url}: is not there; check the address"):
        io.load(server.url("plain", "meta.json"))
    server.files = {**files, "quats.webp": b"RIFF"}
    with pytest.raises(CorruptFileError, match=rf"^{url}: "):
        io.load(server.url("plain", "meta.json"))


def test_errors_and_warnings_name_the_address_without_its_secrets(server: Server) -> None:
    server.files = {"a%20b.ply": PLY[:-3]}
    secret = server.url("plain", "a%20b.ply?token=secret#secret").replace("http://", "http://me:secret@")
    shown = server.url("plain", "a%20b.ply")
    with pytest.raises(CorruptFileError) as caught:
        io.load(secret)
    assert str(caught.value).startswith(f"{shown}: at byte")
    assert caught.value.path == shown
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)
    server.files = {"a%20b.ply": ply_bytes([splats([one_splat(), one_splat(x=np.nan)])])}
    with pytest.warns(LoadWarning) as warned:
        io.load(secret)
    assert str(warned[0].message).startswith(f"{shown}: dropped 1 of 2")


def failure(capsys: pytest.CaptureFixture[str], url: str) -> str:
    """Run what must fail with status 2; return its one line."""
    assert cli.main(["info", url]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    return err


@pytest.mark.parametrize(
    ("how", "path", "words"),
    [
        ("plain", "none.ply", "is not there; check the address"),
        ("403", "scene.ply", "the server answered 403 'Forbidden'"),
        ("503", "scene.ply", "the server answered 503 'Service Unavailable'"),
        ("cut", "scene.ply", "the server stopped in the middle; try again"),
        ("302", "file", "leads on to 'file:///etc/passwd', expected http or https"),
        ("302", "loop", "leads from one address to the next without end"),
        ("endless", "empty.ply", "at byte 0: is empty"),
        ("plain", "page.ply", "is a web page, not the scene itself"),
    ],
)
def test_what_a_server_does_wrong_is_one_line(
    server: Server, capsys: pytest.CaptureFixture[str], how: str, path: str, words: str
) -> None:
    server.files = {
        "scene.ply": PLY,
        "file": b"file:///etc/passwd",
        "loop": b"/302/loop",
        "empty.ply": b"",
        "page.ply": b"<html>",
    }
    url = server.url(how, path)
    assert failure(capsys, url).startswith(f"tsplat: {url}: {words}")


@pytest.mark.parametrize(
    ("how", "content"),
    [
        ("scold", b"x" * 8_000),
        ("scold", b"x" * 100_000),
        ("scold", b"a\x1b[2Jb\x9b"),
        ("302", b"ftp://host/" + b"x" * 8_000),
        ("302", b"ftp://host/" + b"x" * 100_000),
        ("302", b"http://127.0.0.1:1/\x1b[2J" + b"x" * 4_000),
    ],
)
def test_what_a_server_says_is_told_shortly(
    server: Server, capsys: pytest.CaptureFixture[str], how: str, content: bytes
) -> None:
    server.files = {"scene.ply": content}
    line = failure(capsys, server.url(how, "scene.ply"))
    assert len(line) < 400
    assert line.strip().isprintable()


@pytest.mark.parametrize("content", [b"\0", b"<html> ", b"binary \xff\xfe"])
@pytest.mark.parametrize("name", ["scene.ply", "scene", "scene.spz", "scene.json", "scene.sog", "scene.glb"])
def test_what_never_ends_and_is_no_scene_is_given_up_soon(
    server: Server, capsys: pytest.CaptureFixture[str], name: str, content: bytes
) -> None:
    server.files = {name: content * 2048}
    line = failure(capsys, server.url("forever", name))
    assert "at byte 0: " in line or "is a web page, not the scene itself" in line


def test_what_never_ends_leaves_room_on_the_disk(
    server: Server, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(total=1 << 40, free=1 << 20))
    server.files = {"scene.splat": bytes(1 << 16)}
    assert "finds no room in " in failure(capsys, server.url("forever", "scene.splat"))


def test_a_length_beyond_all_disks_is_not_waited_for(server: Server, capsys: pytest.CaptureFixture[str]) -> None:
    server.files = {"scene.ply": PLY}
    assert "finds no room in " in failure(capsys, server.url("boast", "scene.ply"))


def test_a_server_that_drips_is_given_up(
    server: Server, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(arrival, "SLOW_SECONDS", 0.5)
    server.files = {"scene.ply": PLY + bytes(1 << 20)}
    assert "comes too slowly, less than 16384 bytes in 0 s; try again" in failure(
        capsys, server.url("drip", "scene.ply")
    )


def free_port() -> int:
    with socket.socket() as bound:
        bound.bind(("127.0.0.1", 0))
        return int(bound.getsockname()[1])


@pytest.mark.parametrize(
    ("url", "words"),
    [
        (f"http://127.0.0.1:{free_port()}/x.ply", "the server cannot be reached: Connection refused"),
        ("http://nowhere.invalid/x.ply", "no server of this name is known"),
        ("http://", "is no URL that can be fetched"),
        ("http://[bad/x.ply", "is no URL that can be fetched"),
        ("http://host:99999/x.ply", "is no URL that can be fetched"),
        ("ftp://host/x.ply", "is of kind 'ftp', expected http, https, s3 or a path"),
        ("file:///etc/passwd", "is of kind 'file', expected http, https, s3 or a path"),
        ("HTTPX://host/x.ply", "is of kind 'httpx', expected"),
    ],
)
def test_what_leads_nowhere_is_one_line(
    capsys: pytest.CaptureFixture[str], temporary: Path, url: str, words: str
) -> None:
    assert failure(capsys, url).startswith(f"tsplat: {url}: {words}")
    assert list(temporary.iterdir()) == []


def test_a_server_that_does_not_speak_tls_is_one_line(server: Server, capsys: pytest.CaptureFixture[str]) -> None:
    url = server.url("plain", "x.ply").replace("http:", "https:")
    assert "the server cannot be trusted: " in failure(capsys, url)


def test_a_server_that_falls_silent_is_given_up(
    server: Server, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remote, "SILENCE_SECONDS", 0.3)
    monkeypatch.setattr(remote_errors, "SILENCE_SECONDS", 0.3)
    server.files = {"scene.ply": PLY}
    assert "the server said nothing for 0 s; try again" in failure(capsys, server.url("hanging", "scene.ply"))


@pytest.mark.parametrize(("missing", "scheme"), [("fsspec", "https"), ("aiohttp", "https"), ("s3fs", "s3")])
def test_a_missing_library_says_what_to_install(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, missing: str, scheme: str
) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    line = failure(capsys, f"{scheme}://host/x.ply")
    assert f'needs {missing}, which is not installed; pip install "tsplat[remote]"' in line


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_a_download_that_is_ended_leaves_nothing_behind(
    server: Server, temporary: Path, number: signal.Signals, status: int
) -> None:
    server.files = {"scene.ply": PLY + bytes(1 << 20)}
    command = [sys.executable, "-m", "tsplat", "info", server.url("hanging", "scene.ply")]
    environment = {**os.environ, "TMPDIR": str(temporary)}
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=environment,
    )
    try:
        assert server.silent.wait(60)
        end = time.monotonic() + 60
        while not any(path.stat().st_size for path in temporary.glob("tsplat-*/scene.ply")):
            assert time.monotonic() < end, "nothing was written"
            time.sleep(0.05)
        process.send_signal(number)
        out, err = process.communicate(timeout=60)
    finally:
        process.kill()
    assert (process.returncode, out, err.strip()) == (status, b"", b"")


class RefusalError(Exception):
    """What botocore raises."""


class FakeS3:
    """Files in memory, as fsspec would give them."""

    def __init__(self, files: dict[str, bytes]) -> None:
        self.files = files
        self.loop = asyncio.new_event_loop()
        self.thread = threading.Thread(target=self.loop.run_forever)
        self.thread.start()

    async def _get_file(self, url: str, place: str, callback: Any) -> None:
        if url not in self.files:
            raise FileNotFoundError(url)
        callback.set_size(len(self.files[url]))
        Path(place).write_bytes(self.files[url])
        callback.relative_update(len(self.files[url]))

    def close(self) -> None:
        self.loop.call_soon_threadsafe(self.loop.stop)
        self.thread.join()
        self.loop.close()


@pytest.fixture
def s3(temporary: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[FakeS3]:
    errors = ModuleType("botocore.exceptions")
    vars(errors).update(BotoCoreError=RefusalError, ClientError=RefusalError)
    monkeypatch.setitem(sys.modules, "botocore", ModuleType("botocore"))
    monkeypatch.setitem(sys.modules, "botocore.exceptions", errors)
    fake = FakeS3({})
    monkeypatch.setattr(remote, "_file_system", lambda _: fake)
    yield fake
    fake.close()
    assert list(temporary.iterdir()) == []


def test_names_in_s3_are_taken_literally(s3: FakeS3) -> None:
    s3.files = {"s3://bucket/50%20#1?.ply": PLY}
    assert len(io.load("s3://bucket/50%20#1?.ply")) == 1
    files = made_up(np.random.default_rng(1)).files()
    s3.files = {f"S3://bucket/a b?/{name}": content for name, content in files.items()}
    assert len(io.load("S3://bucket/a b?/meta.json")) == 7
    with pytest.raises(LoadError, match=r"^s3://bucket/none\.ply: is not there"):
        io.load("s3://bucket/none.ply")


def test_what_s3_says_is_one_line(s3: FakeS3, capsys: pytest.CaptureFixture[str]) -> None:
    async def refuse(*_: object, **__: object) -> None:
        raise RefusalError("Unable\nto locate\x1b[2J credentials")

    s3._get_file = refuse  # type: ignore[method-assign]
    line = failure(capsys, "s3://bucket/x.ply")
    assert r"'Unable\nto locate\x1b[2J credentials'; check the address and your credentials" in line
