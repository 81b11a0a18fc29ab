"""`tsplat optimize` through the command line's own parser, and what the other commands make of its files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.scenes import random_gaussians
from tsplat import cli, options
from tsplat.io import load, save
from tsplat.lod import Stored
from tsplat.warmup import draw_tiny


@pytest.fixture(scope="module")
def ply(tmp_path_factory: pytest.TempPathFactory) -> Path:
    draw_tiny()
    path = tmp_path_factory.mktemp("scene") / "cloud.ply"
    return save(path, random_gaussians(np.random.default_rng(3), 700, sh_degree=1))


@pytest.fixture(scope="module")
def stored(ply: Path) -> Path:
    path = ply.with_name("cloud.tsplat")
    assert cli.main(["optimize", str(ply), "-o", str(path)]) == 0
    return path


def run(*args: object) -> int:
    return cli.main([str(arg) for arg in args])


def test_it_says_what_it_wrote(ply: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "x.tsplat"
    assert run("optimize", ply, "-o", path) == 0
    out, err = capsys.readouterr()
    assert out.startswith(f"{path}: 700 splats, {path.stat().st_size / 1e6:.2f} MB, optimized in ")
    assert err == ""
    assert [each.name for each in tmp_path.iterdir()] == ["x.tsplat"]


def test_it_may_be_the_file_that_is_read(stored: Path, tmp_path: Path) -> None:
    path = tmp_path / "x.tsplat"
    path.write_bytes(stored.read_bytes())
    assert run("optimize", path, "-o", path, "--max-splats", 300) == 0
    assert len(load(path)) == 300


@pytest.mark.parametrize(
    ("out", "words"), [("x.ply", "suffix '.ply' is not .tsplat"), ("none/x.tsplat", "cannot be written")]
)
def test_what_cannot_be_written_is_one_line_before_anything_is_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], out: str, words: str
) -> None:
    assert run("optimize", "none.ply", "-o", tmp_path / out) == 2
    err = capsys.readouterr().err
    assert words in err
    assert err.count("\n") == 1


def test_a_scene_that_cannot_be_read_leaves_the_old_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "x.tsplat"
    path.write_bytes(b"old")
    assert run("optimize", tmp_path / "none.ply", "-o", path) == 2
    assert "none.ply: cannot be read" in capsys.readouterr().err
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_it_is_rendered_without_being_loaded(
    stored: Path, ply: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ours, theirs = tmp_path / "ours.npy", tmp_path / "theirs.npy"
    size = ("--width", 90, "--height", 60)
    assert run("render", ply, "-o", theirs, *size) == 0
    seen = capsys.readouterr().out.split(": ")[1].rpartition(",")[0]
    monkeypatch.setattr(options, "load_scene", lambda *_: pytest.fail("it was loaded"))
    assert run("render", stored, "-o", ours, *size) == 0
    assert capsys.readouterr().out.split(": ")[1].rpartition(",")[0] == seen
    np.testing.assert_allclose(np.load(ours), np.load(theirs), atol=0.02)
    assert np.abs(np.load(ours) - np.load(theirs)).mean() < 1e-4


def test_it_is_printed_as_the_scene_it_was_made_of(
    stored: Path, ply: Path, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    assert run(ply, "--width", 30) == 0
    theirs = capfdbinary.readouterr().out
    assert run(stored, "--width", 30) == 0
    ours = capfdbinary.readouterr().out
    assert ours.count(b"\n") == theirs.count(b"\n") > 5
    alike = sum(a == b for a, b in zip(ours.split(b"\x1b"), theirs.split(b"\x1b"), strict=False))
    assert alike > 0.9 * len(ours.split(b"\x1b"))


HOW = {"max_splats": None, "raw_opacity": False, "spz_frame": "rub", "lod": 0}


def test_options_that_need_all_of_it_load_it(stored: Path) -> None:
    assert isinstance(options.open_scene(str(stored), HOW), Stored)
    assert len(options.open_scene(str(stored), HOW | {"max_splats": 40})) == 40
    assert not isinstance(options.open_scene(str(stored), HOW | {"max_splats": 900}), Stored)


def test_other_commands_read_it_as_any_scene(
    stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("convert", stored, tmp_path / "x.ply") == 0
    assert len(load(tmp_path / "x.ply")) == 700
    capsys.readouterr()
    assert run("info", stored, "--json") == 0
    assert '"format": "tsplat"' in capsys.readouterr().out


def test_a_broken_one_is_one_line(stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "x.tsplat"
    path.write_bytes(stored.read_bytes()[:-1])
    for command in (["render", path, "-o", tmp_path / "x.png"], ["info", path], [path]):
        assert run(*command) == 2
        err = capsys.readouterr().err
        assert f"{path}: at byte " in err
        assert err.count("\n") == 1
