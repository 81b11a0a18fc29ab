"""Numbers that people and environments say: no option and no variable takes what is none."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import numpy as np
import pytest

from tests.scenes import random_gaussians
from tsplat import cli, kept, numerals
from tsplat.arguments import Number, Numbers, Whole
from tsplat.errors import OptionError
from tsplat.io import save

ARABIC_ONE = "\N{ARABIC-INDIC DIGIT ONE}"
WRONG = (
    "nan",
    "-nan",
    "inf",
    "-inf",
    "infinity",
    "1e999",
    "1e39",
    "²",
    ARABIC_ONE,
    "1_0",
    "0x10",
    "9" * 5000,
    " ",
)
"""What Python takes for a number or a digit, here or there, and nobody means by one."""

PLACES = {"view": ["none.ply"], "render": ["none.ply", "-o", "x.png"], "record": ["x.cast", "none.ply"]}
PLACES |= {"info": ["none.ply"], "convert": ["none.ply", "x.ply"], "optimize": ["none.ply", "-o", "x.tsplat"]}
PLACES |= {"bench": ["none.ply"]}
"""Arguments with which each command comes as far as its options."""

OF_TEXT = (click.STRING, click.BOOL)


def options() -> Iterator[tuple[str, click.Option]]:
    for command in cli.command.commands.values():
        for param in command.params:
            if isinstance(param, click.Option):
                yield str(command.name), param


def numeric() -> Iterator[tuple[str, click.Option]]:
    return ((name, option) for name, option in options() if _takes_numbers(option))


def _takes_numbers(option: click.Option) -> bool:
    return not option.is_flag and not isinstance(option.type, click.Choice) and option.type not in OF_TEXT


def test_every_option_that_is_a_number_is_one_of_our_kinds() -> None:
    found = {(name, option.opts[-1]) for name, option in numeric()}
    assert {("view", "--latency"), ("record", "--seconds"), ("convert", "--scale"), ("bench", "--frames")} < found
    for name, option in numeric():
        if isinstance(option.type, click.types.IntParamType | click.types.FloatParamType):
            assert isinstance(option.type, Number | Whole), f"{name} {option.opts}"


@pytest.mark.parametrize(("name", "option"), list(numeric()), ids=lambda each: getattr(each, "name", each))
def test_no_option_takes_what_is_no_number(
    name: str, option: click.Option, capsys: pytest.CaptureFixture[str]
) -> None:
    count = option.type.count if isinstance(option.type, Numbers) else 1
    for wrong in WRONG:
        text = ",".join([*["1"] * (count - 1), wrong])
        given = [name, *PLACES[name], f"{option.opts[-1]}={text}"]
        assert cli.main(given) == 2
        out, err = capsys.readouterr()
        assert out == ""
        assert err.count("\n") == 1
        assert option.opts[-1] in err, f"{given} was taken"


def test_numbers_are_still_numbers() -> None:
    good = {"1": 1.0, "-2.5": -2.5, "+.5": 0.5, "3.": 3.0, "1e-3": 0.001, "1E38": 1e38, "007": 7.0}
    assert {text: numerals.finite(text) for text in good} == good
    assert [numerals.whole(text) for text in ("0", "-3", "+4", "999999999999")] == [0, -3, 4, 999_999_999_999]
    for wrong in (*WRONG, "", "1e", ".", "--1", "1\n"):
        assert numerals.finite(wrong) is None
        assert numerals.whole(wrong) is None
    assert numerals.whole("1000000000000") is None


@pytest.mark.parametrize("columns", ["²", "\N{ARABIC-INDIC DIGIT ONE}2", "99999999999", "-1", "0", "nan"])
def test_a_size_in_the_environment_that_is_none_is_not_believed(columns: str) -> None:
    names = ("COLUMNS", "LINES", "TERMINAL_WIDTH", "JUPYTER_COLUMNS", "JUPYTER_LINES")
    environment = dict.fromkeys(names, columns)
    assert numerals.columns(environment) is None
    numerals.drop_wrong_sizes(environment)
    assert environment == {}
    numerals.drop_wrong_sizes(kept_as_it_is := {"COLUMNS": "80", "PATH": "²"})
    assert kept_as_it_is == {"COLUMNS": "80", "PATH": "²"}


@pytest.mark.parametrize(("width", "own"), [("²", ""), ("99999999999", "99999999999")])
def test_no_table_is_as_wide_as_the_environment_says(width: str, own: str) -> None:
    environment = {**os.environ, "COLUMNS": width, "LINES": width, "TERMINAL_WIDTH": own}
    for arguments in (["--help"], ["doctor"]):
        command = [sys.executable, "-m", "tsplat", *arguments]
        done = subprocess.run(command, capture_output=True, env=environment, timeout=120, check=False)
        assert (done.returncode, done.stderr) == (0, b"")


@pytest.mark.parametrize("wrong", [*WRONG, "-1", "1e9"])
def test_the_bound_of_what_is_kept_is_a_number_of_gigabytes(wrong: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(kept.SIZE_VARIABLE, wrong)
    with pytest.raises(OptionError, match="must be gigabytes"):
        kept.bound()


EXTREMES = ["--train-focal=0.001", "--train-focal=1000000", "--fov-y=0.001", "--fov-y=179.999", "--eye=3e38,0,0"]
EXTREMES += ["--target=1e-320,3e38,0", "--up=1e-320,0,0", "--up=3e38,-3e38,0", "--background=3e38,0,-3e38"]
EXTREMES += ["--max-splats=999999999999", "--train-focal=1e-300", "--fov-y=1e-300", "--fov-y=180"]


@pytest.mark.usefixtures("compiled")
@pytest.mark.parametrize("option", EXTREMES)
def test_the_largest_and_smallest_numbers_are_a_picture_or_one_line(
    option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = save(tmp_path / "x.ply", random_gaussians(np.random.default_rng(1), 9))
    size = "--width=9", "--height=9"
    status = cli.main(["render", str(scene), "-o", str(tmp_path / "x.png"), *size, "--antialias=relative", option])
    assert status in (0, 2)
    assert capsys.readouterr().err.count("\n") == (status == 2)
