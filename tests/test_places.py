"""A folder or a zip stands for the scene in it, whichever command is given one."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.io.sogs import zipped
from tests.scenes import random_gaussians
from tsplat import cli, io

SCENE = random_gaussians(np.random.default_rng(3), 200, 1)
STEPS = "model/point_cloud/iteration_{}/point_cloud.ply"


@pytest.fixture
def _places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make ``model``, a training whose last step is cut, and ``model.zip``, in the current folder."""
    monkeypatch.chdir(tmp_path)
    for step in (7000, 30000):
        Path(STEPS.format(step)).parent.mkdir(parents=True)
    whole = io.save(STEPS.format(7000), SCENE).read_bytes()
    Path(STEPS.format(30000)).write_bytes(whole[:-1])
    Path("model.zip").write_bytes(zipped({"capture/scene.ply": whole}))


@pytest.mark.usefixtures("_places")
@pytest.mark.parametrize("place", ["model", "model/", "model.zip"])
@pytest.mark.parametrize(
    "command",
    [
        ["view", "PLACE", "--width", "8", "--height", "2"],
        ["render", "PLACE", "-o", "out.png", "--width", "16", "--height", "8"],
        ["info", "PLACE"],
        ["convert", "PLACE", "out.ply"],
        ["optimize", "PLACE", "-o", "out.tsplat"],
        ["record", "out.gif", "PLACE", "--seconds", "0.1", "--width", "16", "--height", "8"],
        ["bench", "PLACE", "--frames", "1", "--size", "16x8", "--threads", "1"],
    ],
    ids=lambda command: str(command[0]),
)
def test_every_command_takes_a_folder_and_a_zip(
    capsys: pytest.CaptureFixture[str], command: list[str], place: str
) -> None:
    assert cli.main([place if word == "PLACE" else word for word in command]) == 0
    out, err = capsys.readouterr()
    if place != "model.zip" and command[0] != "info":  # that says it in its own words
        assert err.count("was opened, as what is newer is not whole") == 1
        assert "iteration_7000" in err
    if command[0] == "info":
        assert ("iteration_7000/point_cloud.ply" in out) == (place != "model.zip")
    if command[0] == "convert":
        np.testing.assert_array_equal(io.load("out.ply").means, SCENE.means)


@pytest.mark.usefixtures("_places")
@pytest.mark.parametrize("command", [["info"], ["render", "-o", "out.png"], ["convert", "out.ply"]])
def test_a_folder_of_several_scenes_is_one_line_and_writes_nothing(
    capsys: pytest.CaptureFixture[str], command: list[str]
) -> None:
    shutil.copy(STEPS.format(7000), "a.ply")
    shutil.copy(STEPS.format(7000), "b.ply")
    assert cli.main([command[0], ".", *command[1:]]) == 2
    err = capsys.readouterr().err
    assert "holds 2 scenes: 'a.ply', 'b.ply'; name one of them" in err
    assert err.count("\n") == 1
    assert not Path("out.png").exists()
    assert not Path("out.ply").exists()
