"""The report as it comes out of a terminal, a pipe, and what can show neither colours nor blocks."""

from __future__ import annotations

from io import BytesIO, TextIOWrapper
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from tests.scenes import random_gaussians
from tsplat.info.bars import ASCII, BLOCKS
from tsplat.info.document import document
from tsplat.info.report import report
from tsplat.io import demo_path

SCENE = random_gaussians(np.random.default_rng(5), 2345, 1)
PROBLEM = "dropped 5 of 9 splats: nan, inf or a zero quat"


def shown(width: int = 80, *, encoding: str = "utf-8", problems: tuple[str, ...] = (), name: str = "x",
          **options: Any) -> str:  # fmt: skip
    output = BytesIO()
    with TextIOWrapper(output, encoding=encoding) as file:
        console = Console(file=file, width=width, highlight=False, **options)
        found = document(name, demo_path(), SCENE, problems)
        console.print(report(found, console.width, blocks=not console.options.ascii_only))
        file.flush()
        return output.getvalue().decode(encoding)


def test_the_report_says_what_the_scene_is_and_how_it_is_spread() -> None:
    text = shown()
    for words in ("format       PLY", "2,345", "SH degree    1", "antialiased  no", "13.0 MB", "radius"):
        assert words in text
    for words in ("opacity", "longest sigma", "flatness", "distance", "view dependence", "p1", "p50", "p99"):
        assert words in text
    assert "no warnings" in text
    assert "\x1b" not in text


@pytest.mark.parametrize(
    ("width", "chart"), [(200, 24), (80, 24), (76, 24), (75, 12), (66, 12), (65, 12), (50, 12), (49, 6), (40, 6)]
)
def test_a_narrow_output_gets_shorter_charts_and_nothing_is_cut_off(width: int, chart: int) -> None:
    lines = shown(width, problems=(PROBLEM,)).splitlines()
    assert all(len(line) <= width for line in lines)
    longest = max("".join(c if c in BLOCKS else " " for c in line).strip().count("") - 1 for line in lines)
    assert longest == chart
    text = " ".join("".join(c if c.isascii() else " " for c in " ".join(lines)).split())
    for words in ("longest sigma", "flatness", "p99", "2,345", "zero quat"):
        assert words in text


@pytest.mark.parametrize("width", [1, 7, 20, 30])
def test_no_terminal_is_too_narrow_to_end_without_an_error(width: int) -> None:
    assert shown(width)


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp437"])
def test_an_output_without_blocks_gets_ascii(encoding: str) -> None:
    text = shown(encoding=encoding, problems=(PROBLEM,))
    assert text.isascii()
    (line,) = [line for line in text.splitlines() if "view dependence" in line]
    assert set(line.split("|")[2].strip()) <= {" ", *ASCII}
    assert "@" in line


def test_colours_are_for_terminals_and_not_with_no_color() -> None:
    colours = "\x1b[32m"
    assert colours in shown(force_terminal=True, color_system="standard")
    assert colours not in shown(force_terminal=True, color_system="standard", no_color=True)
    assert "\x1b" not in shown()


def test_every_warning_has_its_remedy_below() -> None:
    lines = [line.rstrip() for line in shown(problems=(f"{PROBLEM}; buy another", "flags")).splitlines()]
    first = lines.index(f"!  {PROBLEM}")
    assert lines[first - 1] == "warnings"
    assert lines[first + 1] == "   buy another"
    assert lines[first + 2] == "!  flags"
    assert len(lines[first + 3]) > 20


def test_a_name_with_escape_sequences_or_markup_does_nothing_to_the_terminal() -> None:
    text = shown(name="a\x1b[2Jb[red]\n.ply", force_terminal=True, color_system="standard")
    assert r"a\x1b[2Jb[red]\n.ply" in text
