"""What looks wrong: each in a scene made to have it, and none in scenes that were trained."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.scenes import random_gaussians, shared_scenes
from tsplat.framing import bulk
from tsplat.info.findings import Finding, finding_of_loading, findings
from tsplat.info.measures import measure
from tsplat.io import demo_path, load
from tsplat.scene import Gaussians

COUNT = 500
Change = Callable[[dict[str, np.ndarray]], None]

SCENES = shared_scenes()
REAL = [
    "ply/playbot_500k_sh2.ply",
    "ply/plant.ply",
    "ply/academic_tarot_cards.ply",
    "snowmiku/trained/snow_sh3_1000.ply",
    "snowmiku/trained/snow_sh3_3000.ply",
    "format_matrix/yashica.ply",
    "format_matrix/yashica.sog",
    "format_matrix/playbot31k.splat",
    "playbot/6_0/meta.json",
]


def found_in(scene: Gaussians, *, raw_opacity: bool = False, raw_scales: bool = False) -> list[Finding]:
    box = bulk(scene)
    return findings(measure(scene, box), box.radius, raw_opacity=raw_opacity, raw_scales=raw_scales)


def changed(change: Change, count: int = COUNT) -> Gaussians:
    scene = random_gaussians(np.random.default_rng(8), count, 1)
    arrays = {name: getattr(scene, name).copy() for name in ("means", "quats", "scales", "opacities", "sh")}
    arrays["opacities"] = arrays["opacities"].clip(0.01, 0.99)
    change(arrays)
    return Gaussians(**arrays)


def put(name: str, where: Any, value: Any) -> Change:
    def change(arrays: dict[str, np.ndarray]) -> None:
        arrays[name][where] = value

    return change


def huge(opacity: float, scale: float = 30.0) -> Change:
    def change(arrays: dict[str, np.ndarray]) -> None:
        arrays["scales"][:2], arrays["opacities"][:2] = scale, opacity

    return change


def logits_taken_for_opacities(arrays: dict[str, np.ndarray]) -> None:
    arrays["opacities"][:] = 1.0 / (1.0 + np.exp(-arrays["opacities"]))


def bytes_of_those(arrays: dict[str, np.ndarray]) -> None:
    arrays["opacities"][0] = 0.0
    logits_taken_for_opacities(arrays)
    arrays["opacities"][:] = np.floor(255.0 * arrays["opacities"]) / 255.0


def lengths_taken_for_logarithms(factor: float) -> Change:
    """Make the scene so many times as large, then what its scales give when they are read as log scales."""

    def change(arrays: dict[str, np.ndarray]) -> None:
        arrays["means"] *= factor
        arrays["scales"][:] = np.exp(factor * arrays["scales"])

    return change


def larger(factor: float) -> Change:
    def change(arrays: dict[str, np.ndarray]) -> None:
        arrays["means"] *= factor
        arrays["scales"] *= factor

    return change


def test_nothing_is_wrong_with_random_splats() -> None:
    assert found_in(changed(lambda _: None)) == []


@pytest.mark.parametrize(
    ("kind", "change", "count"),
    [
        ("flat", put("scales", (slice(7), 1), 0.0), 7),
        ("flat", put("scales", slice(3), (1e-9, 0.1, 0.1)), 3),
        ("huge", huge(0.5), 2),
        ("far", put("means", slice(4), 1e4), 4),
        ("transparent", put("opacities", slice(9), 0.003), 9),
        ("raw_scales", lengths_taken_for_logarithms(1.0), COUNT),
        ("raw_scales", lengths_taken_for_logarithms(0.001), COUNT),
        ("raw_scales", lengths_taken_for_logarithms(8.0), COUNT),
        ("reset_opacity", put("opacities", slice(None), 0.0199), COUNT),
        ("raw_opacity", logits_taken_for_opacities, COUNT),
        ("raw_opacity", bytes_of_those, COUNT),
        ("hard_opacity", put("opacities", slice(None), 1.0), COUNT),
        ("reset_opacity", put("opacities", slice(None), 0.01), COUNT),
        ("colors", put("sh", (slice(6), 0, 2), 40.0), 6),
        ("colors", put("sh", (slice(6), 0, 0), -40.0), 6),
    ],
)
def test_what_looks_wrong_is_found_and_counted(kind: str, change: Change, count: int) -> None:
    (found,) = found_in(changed(change))
    assert (found.kind, found.count, found.share) == (kind, count, count / COUNT)
    assert found.text.startswith(f"{count} of {COUNT} splats ({100 * count / COUNT:.3g} %) ")
    assert len(found.remedy) > 20


@pytest.mark.parametrize(
    "change",
    [
        put("scales", slice(3), (1e-7, 0.1, 0.1)),
        huge(0.01),
        huge(0.5, 2.0),
        put("opacities", slice(1, None), 0.019),
        larger(1e5),
        put("means", slice(4), 10.0),
        put("opacities", slice(4), 0.0),
        put("sh", (slice(6), 0, 2), 4.0),
        put("sh", (slice(4), 0, 2), 40.0),
    ],
    ids=[
        "thin",
        "a faint giant",
        "a large one",
        "all but one faint",
        "large units",
        "a little away",
        "few unseen",
        "bright",
        "few too bright",
    ],
)
def test_what_trained_scenes_may_have_is_no_finding(change: Change) -> None:
    assert found_in(changed(change)) == []


@pytest.mark.parametrize(("flat", "kinds"), [(1, []), (2, ["flat"])])
def test_one_flat_splat_in_two_thousand_is_not_worth_a_word(flat: int, kinds: list[str]) -> None:
    found = found_in(changed(put("scales", (slice(flat), 1), 0.0), 2000))
    assert [each.kind for each in found] == kinds


def test_few_splats_may_all_have_the_same_opacity() -> None:
    for value in (0.6, 1.0, 0.0):
        kinds = [found.kind for found in found_in(changed(put("opacities", slice(None), value), 9))]
        assert kinds == (["transparent"] if value == 0.0 else [])


def test_scales_read_as_they_are_raise_no_question_about_it() -> None:
    linear = changed(lengths_taken_for_logarithms(1.0))
    assert "try --raw-scales" in found_in(linear)[0].remedy
    assert found_in(linear, raw_scales=True) == []


def test_the_remedy_for_opacities_knows_with_what_the_file_was_read() -> None:
    raw, hard = changed(logits_taken_for_opacities), changed(put("opacities", slice(None), 1.0))
    assert "try --raw-opacity" in found_in(raw)[0].remedy
    assert found_in(raw, raw_opacity=True) == []
    assert "leave --raw-opacity out" in found_in(hard, raw_opacity=True)[0].remedy
    assert "--raw-opacity" not in found_in(hard)[0].remedy


def test_several_findings_come_the_worst_first() -> None:
    def change(arrays: dict[str, np.ndarray]) -> None:
        arrays["opacities"][:] = 1.0
        arrays["scales"][:3, 0] = 0.0
        arrays["means"][3] = 1e5

    assert [found.kind for found in found_in(changed(change))] == ["hard_opacity", "far", "flat"]


def test_an_empty_scene_has_no_findings() -> None:
    assert found_in(random_gaussians(np.random.default_rng(0), 0)) == []


@pytest.mark.parametrize(
    "path", [demo_path(), *(SCENES / name for name in REAL if SCENES)], ids=lambda path: path.name
)
def test_a_trained_scene_raises_no_false_alarm(path: object) -> None:
    assert found_in(load(path)) == []


@pytest.mark.parametrize(
    ("problem", "text", "remedy", "count", "share"),
    [
        ("dropped 5 of 9 splats: nan", "dropped 5 of 9 splats: nan", None, 5, 5 / 9),
        ("2 of 4 opacities lay outside; leave it", "2 of 4 opacities lay outside", "leave it", 2, 0.5),
        ("flags 0x3 announce extensions; it may", "flags 0x3 announce extensions", "it may", None, None),
        ("dropped 0 of 0 splats", "dropped 0 of 0 splats", None, 0, None),
    ],
)
def test_a_warning_of_a_reader_is_taken_at_its_word(
    problem: str, text: str, remedy: str | None, count: int | None, share: float | None
) -> None:
    found = finding_of_loading(problem)
    assert (found.kind, found.text, found.count, found.share) == ("loading", text, count, share)
    assert found.remedy == remedy or remedy is None
    assert found.remedy
