"""What `tsplat info` says of what is up, and of an SPZ that stands on its head."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.panels import chair, drone_scan, mug
from tsplat import cli, edit, io
from tsplat.scene import Gaussians


def told(capsys: pytest.CaptureFixture[str], path: Path, scene: Gaussians, *args: str) -> dict[str, Any]:
    io.save(path, scene)
    capsys.readouterr()
    assert cli.main(["info", str(path), "--json", *args]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def kinds(found: dict[str, Any]) -> list[str]:
    return [warning["kind"] for warning in found["warnings"] if warning["kind"] != "flat"]


def test_info_says_what_is_up_by_what_and_how_surely(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    ground, nothing = (told(capsys, tmp_path / "x.ply", scene)["up"] for scene in (drone_scan(), chair()))
    assert (ground["direction"], ground["cue"], ground["sureness"]) == ([0.0, 0.0, 1.0], "ground", "sure")
    assert nothing["text"] == "-y, weak: the usual, nothing in the scene tells; --up says it"


@pytest.mark.parametrize("scene", [mug(1.0), edit.rotate(drone_scan(), (-90, 0, 0))], ids=["light", "a ground"])
def test_an_spz_on_its_head_is_named_with_what_reads_it_upright(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, scene: Gaussians
) -> None:
    on_its_head = told(capsys, tmp_path / "x.spz", scene)
    assert "axes" in kinds(on_its_head)
    assert "--spz-frame rdf" in next(each["remedy"] for each in on_its_head["warnings"] if each["kind"] == "axes")
    upright = told(capsys, tmp_path / "x.spz", scene, "--spz-frame", "rdf")
    assert "axes" not in kinds(upright)
    assert upright["up"]["direction"] == [0.0, -1.0, 0.0]
    assert "axes" not in kinds(told(capsys, tmp_path / "x.ply", scene))
