"""`tsplat info` as a shell starts it."""

from __future__ import annotations

import gzip
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.scenes import random_gaussians
from tests.terminal.ptys import Terminal
from tsplat import cli
from tsplat.info.bars import BLOCKS
from tsplat.io import save

INFO = (sys.executable, "-m", "tsplat", "info")
README = Path(__file__).parents[2] / "README.md"


@pytest.fixture
def broken(tmp_path: Path) -> Path:
    """Return a scene of 40 splats; the first has nan, the second next to no extent along x."""
    path = save(tmp_path / "broken.ply", random_gaussians(np.random.default_rng(3), 40, 0))
    content = bytearray(path.read_bytes())
    first = content.index(b"end_header\n") + len(b"end_header\n")
    row = (len(content) - first) // 40
    content[first : first + 4] = np.float32(np.nan).tobytes()
    content[first + row + row - 28 : first + row + row - 24] = np.float32(-90.0).tobytes()
    path.write_bytes(content)
    return path


def piped(*arguments: object, **environment: str) -> subprocess.CompletedProcess[str]:
    # UTF-8 whatever the locale of the tests.
    kept = {"PYTHONUTF8": "1"} | {
        name: value for name, value in os.environ.items() if name not in ("COLUMNS", "LINES", "NO_COLOR")
    }
    command = [*INFO, *map(str, arguments)]
    return subprocess.run(
        command, env=kept | environment, capture_output=True, encoding="utf-8", timeout=120, check=False,
        stdin=subprocess.DEVNULL,
    )  # fmt: skip


def test_warnings_are_in_the_report_once_and_no_reason_to_fail(broken: Path) -> None:
    ran = piped(broken)
    assert (ran.returncode, ran.stderr) == (0, "")
    assert ran.stdout.count("dropped 1 of 40 splats") == 1
    assert ran.stdout.count("1 of 39 splats (2.56 %) are flat") == 1
    assert "\x1b" not in ran.stdout


def test_as_json_the_same_warnings_come_with_their_numbers(broken: Path) -> None:
    ran = piped(broken, "--json")
    assert (ran.returncode, ran.stderr) == (0, "")
    found = json.loads(ran.stdout, parse_constant=pytest.fail)
    assert (found["version"], found["scene"], found["splats"]) == (1, str(broken), 39)
    warnings = [(warning["kind"], warning["count"], warning["share"]) for warning in found["warnings"]]
    assert warnings == [("loading", 1, 1 / 40), ("flat", 1, 1 / 39)]


def test_a_packed_scene_is_reported_as_what_it_unpacks_to(
    broken: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    packed = broken.with_name("broken.ply.gz")
    packed.write_bytes(gzip.compress(broken.read_bytes()))
    found = []
    for path in (broken, packed):
        assert cli.main(["info", str(path), "--json"]) == 0
        found.append(json.loads(capsys.readouterr().out))
    assert found[1].pop("scene") == str(packed)
    assert found[0].pop("scene") == str(broken)
    assert found[0] == found[1]


def test_options_of_loading_are_heard(broken: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["info", str(broken), "--json", "--max-splats", "7"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["splats"], found["disk_bytes_per_splat"]) == (7, None)
    assert cli.main(["info", str(broken), "--json", "--raw-opacity"]) == 0
    assert any("clamped" in warning["text"] for warning in json.loads(capsys.readouterr().out)["warnings"])


def test_an_empty_scene_is_no_error(tmp_path: Path) -> None:
    path = save(tmp_path / "empty.ply", random_gaussians(np.random.default_rng(0), 0))
    ran = piped(path)
    assert (ran.returncode, ran.stderr) == (0, "")
    assert "splats       0" in ran.stdout
    assert piped(path, "--json").returncode == 0


def test_a_file_that_is_no_scene_is_one_line_and_status_2(tmp_path: Path) -> None:
    path = tmp_path / "x.ply"
    path.write_bytes(b"ply\nformat")
    ran = piped(path)
    assert (ran.returncode, ran.stdout, ran.stderr.count("\n")) == (2, "", 1)


def test_a_pipe_that_cannot_say_blocks_gets_ascii() -> None:
    ran = piped("demo", PYTHONIOENCODING="ascii")
    assert (ran.returncode, ran.stderr) == (0, "")
    assert ran.stdout.isascii()
    assert "@" in ran.stdout


def test_a_terminal_gets_colours_and_its_own_width() -> None:
    with Terminal(*INFO, "demo", environment={"COLORTERM": "truecolor"}) as terminal:
        terminal.resize(60, 50)
        assert terminal.wait() == 0
        lines = terminal.seen.decode().split("\r\n")
    assert any("\x1b[32m" in line for line in lines)
    plain = [re.sub(r"\x1b\[[\d;]*m", "", line) for line in lines]
    assert max(map(len, plain)) == 60


def test_the_readme_shows_what_the_demo_looks_like(request: pytest.FixtureRequest) -> None:
    output = "\n".join(line.rstrip() for line in piped("demo").stdout.splitlines())
    assert set(BLOCKS) < set(output)
    before, command, rest = README.read_text().partition("$ tsplat info demo\n")
    shown, fence, after = rest.partition("\n```")
    assert command
    if request.config.getoption("--update-goldens"):
        README.write_text(before + command + output + fence + after)
        shown = output
    assert shown == output, "run pytest --update-goldens tests/info and look at the README"
