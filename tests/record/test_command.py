"""`tsplat record` through the command line's own parser, and as a process that is interrupted."""

from __future__ import annotations

import io
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tests.record.casts import read_cast, screen_of
from tests.scenes import random_gaussians
from tests.test_export import FLOORS, psnr, read
from tsplat import cli, export, progress
from tsplat.images import quantize
from tsplat.io import save

pytestmark = pytest.mark.usefixtures("compiled")

SMALL = "--width", 64, "--height", 48, "--seconds", 0.5, "--fps", 10


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "cloud.ply"
    return save(path, random_gaussians(np.random.default_rng(3), 300, sh_degree=1))


def record(*args: object) -> int:
    return cli.main(["record", *map(str, args)])


@pytest.mark.parametrize(
    ("args", "words"),
    [
        ([], "Missing argument 'OUT.cast|.gif|.webp|.mp4'"),
        (["x.avi"], "'.avi' is no recording; use one of .cast, .gif, .webp, .mp4"),
        (["x"], "'' is no recording"),
        (["none/x.gif"], "none/x.gif: cannot be written: No such file or directory; choose another folder"),
        (["x.gif", "none.ply"], "none.ply: cannot be read"),
        (["x.gif", "--seconds", "0"], "0.0 is not in the range"),
        (["x.gif", "--fps", "61"], "61 is not in the range"),
        (["x.gif", "--fps", "60"], "at most 50 frames a second"),
        (["x.mp4", "--width", "641"], "must be even, got 641 x 360"),
        (["x.cast", "--output", "kitty"], "--output kitty is not drawn by players of .cast; use "),
        (["x.cast", "--output", "sixel"], "--output sixel is not drawn by players"),
        (["x.cast", "--width", "80"], "--width says nothing about a .cast of an orbit; it takes --seconds"),
        (["x.gif", "--rows", "24"], "--rows says nothing about a .gif of an orbit"),
        (["x.gif", "--output", "half"], "--output says nothing about a .gif of an orbit"),
        (["x.cast", "--live", "--fps", "9"], "--fps says nothing about a .cast of a session; it takes --output"),
        (["x.gif", "--live", "--seconds", "9"], "--seconds says nothing about a .gif of a session"),
        (["x.gif", "demo", "--live"], "standard output is not a terminal"),
        (["x.cast", "demo", "--live"], "standard output is not a terminal"),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_one_line_and_leaves_no_file(
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    args: list[str],
    words: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert record(*args) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert words in err
    assert err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_folder_that_takes_no_file_is_known_before_the_scene_is_read(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert record(tmp_path / "none" / "x.gif", tmp_path / "none.ply") == 2
    assert "x.gif: cannot be written" in capsys.readouterr().err


def test_a_missing_video_library_is_known_at_once(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(export, "find_spec", lambda _: None)
    assert record(tmp_path / "x.mp4", "none.ply") == 2
    assert "pip install 'tsplat[video]'" in capsys.readouterr().err


@pytest.mark.parametrize("suffix", export.SUFFIXES)
def test_a_moving_picture_begins_with_what_render_draws(
    capsys: pytest.CaptureFixture[str], scene: Path, tmp_path: Path, suffix: str
) -> None:
    path = tmp_path / f"x{suffix}"
    assert record(path, scene, *SMALL) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert re.fullmatch(rf"{re.escape(str(path))}: 5 frames of 64 x 48, \d+ kB\n", out)
    frames, seconds = read(path)
    assert (len(frames), seconds) == (5, pytest.approx(0.5))
    still = tmp_path / "x.npy"
    size = "--width", "64", "--height", "48"
    assert cli.main(["render", str(scene), "-o", str(still), *size, "--antialias", "relative"]) == 0
    assert psnr(frames[0], quantize(np.load(still)[..., :3])) > FLOORS[suffix] - 4
    assert psnr(frames[0], frames[2]) < 22
    assert {each.name for each in tmp_path.iterdir()} == {"x.npy", path.name}


def cells(path: Path, until: int) -> list[tuple[str, str, str]]:
    header, events = read_cast(path.read_bytes())
    screen = screen_of(header, events[:until])
    every = (screen.buffer[row][column] for row in range(screen.lines) for column in range(screen.columns))
    return [(cell.data, cell.fg, cell.bg) for cell in every]


def test_a_cast_shows_the_scene_in_cells(capsys: pytest.CaptureFixture[str], scene: Path, tmp_path: Path) -> None:
    path = tmp_path / "x.cast"
    assert record(path, scene, "--columns", 30, "--rows", 10, "--seconds", 0.5, "--fps", 4) == 0
    assert "2 frames of 30 x 10 cells" in capsys.readouterr().out
    header, events = read_cast(path.read_bytes())
    assert header["term"] == {"cols": 30, "rows": 10, "type": "xterm-256color"}
    assert header["title"] == "cloud"
    assert events[-1].seconds == 0.5
    first = cells(path, 1)
    assert len(first) == 300
    assert len(set(first)) > 50
    assert first != cells(path, 2)


@pytest.mark.parametrize(
    "args",
    [
        ["--up", "z"],
        ["--fov-y", 30],
        ["--sh-degree", 0],
        ["--antialias", "mip"],
        ["--background", "white"],
        ["--max-splats", 20],
        ["--raw-opacity"],
        ["--train-focal", 100],
        ["--output", "half256"],
        ["--columns", 31],
        ["--rows", 11],
        ["--turns", 2],
        ["--turns", -1],
        ["--seconds", 1],
        ["--fps", 8],
    ],
    ids=lambda args: " ".join(map(str, args)),
)
def test_every_option_changes_the_recording(scene: Path, tmp_path: Path, args: list[object]) -> None:
    one, other = tmp_path / "1.cast", tmp_path / "2.cast"
    basic = ["--columns", 30, "--rows", 10, "--seconds", 0.75, "--fps", 4]
    assert record(one, scene, *basic) == record(other, scene, *basic, *args) == 0
    assert one.read_bytes() != other.read_bytes()


def test_the_same_orbit_is_the_same_file(scene: Path, tmp_path: Path) -> None:
    one, other = tmp_path / "1.cast", tmp_path / "2.cast"
    for path, threads in ((one, 1), (other, 2)):
        assert record(path, scene, "--seconds", 0.1, "--threads", threads) == 0
    assert one.read_bytes() == other.read_bytes()


@pytest.mark.parametrize("suffix", [".cast", ".webp"])
def test_a_terminal_is_shown_how_far_it_is(
    scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str
) -> None:
    stderr = io.StringIO()
    monkeypatch.setattr(stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", stderr)
    monkeypatch.setattr(progress, "BAR_AFTER", 0.0)
    assert record(tmp_path / f"x{suffix}", scene, "--seconds", 0.2) == 0
    assert f"recording x{suffix}" in stderr.getvalue()
    assert "100%" in stderr.getvalue()


@pytest.mark.parametrize("suffix", [".cast", *export.SUFFIXES])
def test_ctrl_c_leaves_the_old_file_and_nothing_half_written(scene: Path, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"x{suffix}"
    path.write_bytes(b"old")
    command = [sys.executable, "-m", "tsplat", "record", str(path), str(scene), "--seconds", "3000"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    deadline = time.monotonic() + 60
    while len(os.listdir(tmp_path)) < 2:  # the file beside it
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.05)
    time.sleep(2.0)
    assert process.poll() is None
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert b"Traceback" not in err, err.decode()
    assert process.returncode == 130, err.decode()
    assert out == b""
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_nothing_of_it_is_imported_for_help() -> None:
    code = "import sys; from tsplat import cli; cli.main(['record', '--help']); print(list(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=120, check=True)
    modules = done.stdout.decode().splitlines()[-1]
    assert "'tsplat.record.command'" in modules
    for heavy in (
        "'numba'",
        "'PIL'",
        "'av'",
        "'tsplat.export'",
        "'tsplat.viewer'",
        "'tsplat.raster'",
        "'tsplat.terminal'",
    ):
        assert heavy not in modules
