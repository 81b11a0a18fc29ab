"""A scene as a plain document."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.scenes import random_gaussians, shared_scenes
from tsplat.framing import bulk
from tsplat.info.document import document
from tsplat.io import demo_path, load, save
from tsplat.scene import Gaussians

SCENE = random_gaussians(np.random.default_rng(2), 1001, 2)
SCENES = shared_scenes()
KEYS = [
    *("version", "scene", "format", "files", "disk_bytes", "disk_bytes_per_splat", "splats", "sh_degree"),
    *("antialiased", "origin", "frame", "memory_bytes", "box", "bulk", "up", "distributions", "warnings"),
]
PAGE = Path(__file__).parents[2] / "docs" / "info.md"


def of(gaussians: Gaussians, **options: Any) -> dict[str, Any]:
    return document("x", demo_path(), gaussians, **options)


def test_every_number_is_that_of_the_scene() -> None:
    found, box = of(SCENE), bulk(SCENE)
    assert (found["splats"], found["sh_degree"], found["antialiased"]) == (1001, 2, False)
    assert found["memory_bytes"] == 1001 * 4 * (3 + 4 + 3 + 1 + 27)
    assert found["box"] == {"low": SCENE.means.min(axis=0).tolist(), "high": SCENE.means.max(axis=0).tolist()}
    assert found["bulk"]["center"] == box.center.tolist()
    assert (found["bulk"]["low"], found["bulk"]["high"]) == (box.low.tolist(), box.high.tolist())
    assert found["bulk"]["radius"] == box.radius
    spread = {name: each["percentiles"] for name, each in found["distributions"].items()}
    assert spread["opacity"]["50"] == pytest.approx(float(np.median(SCENE.opacities)))
    assert spread["longest_sigma"]["100"] == pytest.approx(float(SCENE.scales.max()))
    assert spread["flatness"]["100"] <= 1.0
    assert 0.3 < spread["distance"]["50"] < 0.9
    assert found["disk_bytes_per_splat"] == demo_path().stat().st_size / 1001


@pytest.mark.parametrize("count", [0, 1, 1001])
def test_a_document_survives_json_and_says_the_same_keys_for_any_scene(count: int) -> None:
    found = of(SCENE.take(range(count)))
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert list(found) == KEYS
    assert found["splats"] == count
    assert (found["box"] is None) == (count == 0)
    assert len(found["distributions"]) == (5 if count else 0)
    assert (found["disk_bytes_per_splat"] is None) == (count == 0)


def test_every_key_is_described_in_the_docs() -> None:
    text = PAGE.read_text()
    spread = of(SCENE)["distributions"]
    for key in (*KEYS, *spread, *spread["opacity"], *spread["opacity"]["histogram"]):
        assert f"`{key}`" in text, key


def test_warnings_of_the_reader_come_first_once_and_without_the_path() -> None:
    flat = SCENE.scales.copy()
    flat[:5, 2] = 0.0
    scene = Gaussians(SCENE.means, SCENE.quats, flat, SCENE.opacities, SCENE.sh)
    warnings = of(scene, problems=[f"{demo_path()}: dropped 5 of 9 splats: nan, inf or a zero quat"])["warnings"]
    assert [warning["kind"] for warning in warnings] == ["loading", "flat"]
    assert warnings[0]["text"] == "dropped 5 of 9 splats: nan, inf or a zero quat"
    assert (warnings[0]["count"], warnings[0]["share"]) == (5, 5 / 9)
    assert set(warnings[0]) == set(warnings[1]) == {"kind", "text", "remedy", "count", "share"}


def test_a_scene_trained_for_antialiasing_is_said_to_be() -> None:
    assert of(replace(SCENE, antialiased=True))["antialiased"] is True


def test_axes_of_an_spz_are_said_and_by_what_they_are_known(tmp_path: Path) -> None:
    path = save(tmp_path / "scene.spz", SCENE)
    assert document("x", path, SCENE)["frame"] == {"name": "rub", "source": "format"}
    assert document("x", path, SCENE, spz_frame="luf")["frame"] == {"name": "luf", "source": "option"}
    assert of(SCENE)["frame"] is None


def test_bytes_a_splat_are_said_of_whole_files_only() -> None:
    assert of(SCENE, max_splats=5000)["disk_bytes_per_splat"] is None
    assert of(SCENE)["disk_bytes_per_splat"] is not None


def test_the_same_scene_is_described_alike_whatever_its_format(tmp_path: Path) -> None:
    found = []
    for suffix in (".ply", ".compressed.ply", ".spz"):
        path = save(tmp_path / f"scene{suffix}", SCENE)
        found.append(document("x", path, load(path)))
    assert len({each["format"] for each in found}) == 3
    for name, spread in found[0]["distributions"].items():
        for other in found[1:]:
            for percent in ("25", "50", "75"):
                value = other["distributions"][name]["percentiles"][percent]
                assert value == pytest.approx(spread["percentiles"][percent], rel=0.05), (name, other["format"])


@pytest.mark.skipif(SCENES is None, reason="no folder of real scenes: set TSPLAT_SCENES")
@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("ply/plant.ply", ("PLY", 113_648, 0, 56, 0.196, 0.0926)),
        ("snowmiku/trained/snow_sh3_3000.ply", ("PLY", 37_900, 3, 248, 0.410, 0.229)),
        ("format_matrix/yashica.sog", ("SOG", 8192, 3, 55, 0.875, 0.0220)),
        ("playbot/lod-meta.json", ("SOG", 500_000, 2, None, 0.678, 0.0473)),
    ],
)
def test_real_scenes_have_the_figures_that_were_measured_apart(name: str, expected: tuple[Any, ...]) -> None:
    assert SCENES is not None
    form, count, degree, each, opacity, flatness = expected
    found = document(name, SCENES / name, load(SCENES / name))
    assert (found["format"], found["splats"], found["sh_degree"]) == (form, count, degree)
    assert (found["disk_bytes_per_splat"] and int(found["disk_bytes_per_splat"])) == each
    assert found["distributions"]["opacity"]["percentiles"]["50"] == pytest.approx(opacity, rel=0.01)
    assert found["distributions"]["flatness"]["percentiles"]["50"] == pytest.approx(flatness, rel=0.01)
    assert found["warnings"] == []
