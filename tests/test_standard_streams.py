"""Standard output and error that fail, for every command: one line at most, and the exit status tells it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tsplat import __version__, cli
from tsplat._kernel_cache import cache_folder

pytestmark = [
    pytest.mark.usefixtures("compiled"),
    pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no disk that is always full"),
]

COMMANDS = {
    "--version": "",
    "--help": "",
    "render --help": "",
    "demo --width 8": "",
    "info demo": "",
    "info demo --json": "",
    "cache": "",
    "cache --clear": "",
    "doctor": "",
    "doctor --json": "",
    "render demo -o {}.png --width 16 --height 16": ".png",
    "convert demo {}.ply": ".ply",
    "convert demo {}.spz --json": ".spz",
    "optimize demo -o {}.tsplat --max-splats 1000": ".tsplat",
    "record {}.cast --seconds 0.1 --columns 9 --rows 4": ".cast",
}
"""And the suffix of what each writes."""

COMPILING = "tsplat: compiling kernels, first run only\n"
LOST = "tsplat: standard output: cannot be written: "


def shell(command: str, redirected: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a command of tsplat in a shell that sends its streams elsewhere."""
    words = command.format(folder / "out")
    kernels = cache_folder()
    assert kernels  # nothing is compiled again where other things are kept elsewhere
    environment = {"NUMBA_CACHE_DIR": str(kernels.parent), **os.environ, "XDG_CACHE_HOME": str(folder)}
    environment["LC_ALL"] = "C.UTF-8"
    environment.pop("PYTHONUNBUFFERED", None)  # what is in a buffer is tried again when Python ends
    line = f"exec '{sys.executable}' -m tsplat {words} {redirected}"
    return subprocess.run(
        ["/bin/sh", "-c", line], capture_output=True, text=True, env=environment, timeout=120, check=False
    )


FULL, CLOSED = (">/dev/full", "No space left on device\n"), (">&-", "it is closed\n")


@pytest.mark.parametrize(
    ("command", "redirected", "why"),
    [*((command, *FULL) for command in COMMANDS), *((command, *CLOSED) for command in list(COMMANDS)[1::4])],
)
def test_output_that_fails_is_one_line_and_status_2_and_what_was_written_is_whole(
    command: str, redirected: str, why: str, tmp_path: Path
) -> None:
    done = shell(command, redirected, tmp_path)
    assert (done.returncode, done.stderr, done.stdout) == (2, LOST + why, "")
    assert [path.suffix for path in tmp_path.iterdir() if path.is_file()] == (
        [COMMANDS[command]] if COMMANDS[command] else []
    )


@pytest.mark.parametrize("redirected", ["2>/dev/full", "2>&-", "<&- 2>&-"])
def test_where_errors_cannot_be_said_the_status_tells_them_and_output_is_as_ever(
    redirected: str, tmp_path: Path
) -> None:
    done = shell("info none.ply", redirected, tmp_path)
    assert (done.returncode, done.stderr, done.stdout) == (2, "", "")
    done = shell("--version", redirected, tmp_path)
    assert (done.returncode, done.stderr, done.stdout) == (0, "", f"tsplat {__version__}\n")


@pytest.mark.parametrize("redirected", [">/dev/full 2>/dev/full", ">&- 2>&-", "<&- >&- 2>&-"])
def test_where_nothing_can_be_said_files_are_written_all_the_same(redirected: str, tmp_path: Path) -> None:
    done = shell("render demo -o {}.npy --width 16 --height 16", redirected, tmp_path)
    assert (done.returncode, done.stderr, done.stdout) == (2, "", "")
    assert (tmp_path / "out.npy").stat().st_size == 128 + 16 * 16 * 16


def test_a_warning_that_cannot_be_said_stops_nothing(tmp_path: Path) -> None:
    (tmp_path / "demo.ply").symlink_to(Path(cli.__file__).parent / "demo.ply")
    (tmp_path / "transforms.json").write_text("{}")
    done = shell(f"render {tmp_path}/demo.ply -o {{}}.png --width 16 --height 16", "2>/dev/full", tmp_path)
    assert done.returncode == 0
    assert done.stdout.startswith(f"{tmp_path}/out.png: 16 x 16")


def test_what_an_encoding_lacks_is_escaped(tmp_path: Path) -> None:
    done = shell("render demo -o '{}-\N{SNOWMAN}.png' --width 16 --height 16", "| cat", tmp_path)
    assert done.stdout.startswith(f"{tmp_path}/out-\N{SNOWMAN}.png: ")
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    command = [sys.executable, "-m", "tsplat", "render", "demo", "-o", f"{tmp_path}/\N{SNOWMAN}.png", "--width=8"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=120, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(f"{tmp_path}/\\u2603.png: ")


@pytest.mark.parametrize("command", ["info demo", "--help", "demo", "info demo --json"])
def test_a_reader_that_leaves_early_hears_nothing_more(command: str, tmp_path: Path) -> None:
    done = shell(command, "| head -c 1 >/dev/null", tmp_path)
    assert done.stderr == ""


RAW = "\x1b[31mred\x9b0m\u202e"
ESCAPED = "\\x1b[31mred\\x9b0m\\u202e"


@pytest.mark.parametrize(
    "command",
    [
        ["render", "demo", "-o", "{}.png", "--width", "8", "--height", "8"],
        ["render", "demo", "-o", "{}.tiff"],
        ["render", "demo", "-o", "{}/none/x.png", "--width", "8", "--height", "8"],
        ["convert", "demo", "{}.ply", "--max-splats", "100"],
        ["convert", "demo", "{}.txt"],
        ["convert", "demo", "{}/none/x.ply"],
        ["convert", "{}.ply", "x.ply"],
        ["optimize", "demo", "-o", "{}.tsplat", "--max-splats", "1000"],
        ["optimize", "demo", "-o", "{}.txt"],
        ["optimize", "demo", "-o", "{}/none/x.tsplat"],
        ["record", "{}.cast", "--seconds", "0.1", "--columns", "9", "--rows", "4"],
        ["record", "{}.txt"],
        ["record", "{}/none/x.gif"],
        ["info", "{}.ply"],
        ["bench", "{}.ply"],
        ["view", "{}.ply"],
        ["{}"],
        ["render", "--{}"],
        ["view", "--output", "{}"],
        ["render", "demo", "-o", "x.png", "--width", "{}"],
    ],
    ids=" ".join,
)
def test_no_escape_sequence_of_an_argument_is_printed(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    cli.main([word.format(RAW) for word in command])
    out, err = capsys.readouterr()
    said = (out + err).replace("\n", "")
    assert "red" in said
    assert not [c for c in said if not c.isprintable()]
    assert err.count("\n") <= 1


def test_json_escapes_what_terminals_would_heed(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / f"{RAW}.ply"
    assert cli.main(["convert", "demo", str(path), "--max-splats", "100", "--json"]) == 0
    assert not [c for c in capsys.readouterr().out.replace("\n", "") if not c.isprintable()]
