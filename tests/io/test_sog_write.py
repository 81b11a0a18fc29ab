"""SOG files that are written: read by the slow twin and by the reader, and seen as pictures."""

from __future__ import annotations

import io as streams
import json
import warnings
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.io.alike import angles, picture
from tests.io.sogs import Scene, made_up, read_slowly
from tests.raster.compare import psnr
from tests.scenes import random_gaussians, shared_scenes
from tsplat import io
from tsplat._jit import JIT
from tsplat.errors import SaveError, SaveWarning
from tsplat.io.compressed_ply_write import morton_order
from tsplat.scene import Gaussians

SCENES = shared_scenes()
needs_scenes = pytest.mark.skipif(
    SCENES is None, reason="no folder of real scenes: set TSPLAT_SCENES or have ../shared/scenes"
)

WIDEST = 1.15
"""Degrees: half a step of each component, and what that makes of the fourth."""


def unpacked(path: Path) -> Scene:
    with zipfile.ZipFile(path) as archive:
        names = [name for name in archive.namelist() if name.endswith(".webp")]
        images = {name: Image.open(streams.BytesIO(archive.read(name))) for name in names}
        planes = {name.removesuffix(".webp"): np.asarray(image.convert("RGBA")) for name, image in images.items()}
        return Scene(json.loads(archive.read("meta.json")), planes)


def log(means: np.ndarray) -> np.ndarray:
    return np.asarray(np.sign(means) * np.log1p(np.abs(means.astype(np.float64))))


@pytest.mark.parametrize("degree", range(5))
def test_saving_writes_what_the_slow_reader_reads(tmp_path: Path, rng: np.random.Generator, degree: int) -> None:
    before = random_gaussians(rng, 50, degree)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SaveWarning)  # of degree 4
        scene = unpacked(io.save(tmp_path / "scene.sog", before))
    assert scene.meta["count"] == 50
    assert scene.meta.get("shN", {}).get("bands", 0) == min(degree, 3)
    step = np.ptp(log(before.means), axis=0) / 65535
    for index, source in enumerate(morton_order(before.means)):
        found = {name: np.array(values) for name, values in read_slowly(scene, index).items()}
        assert np.all(np.abs(log(found["means"]) - log(before.means[source])) <= 0.501 * step)
        assert angles(found["quats"][None], before.quats[[source]]) < WIDEST
        np.testing.assert_allclose(found["scales"], before.scales[source], rtol=1e-5, err_msg="fewer than 256")
        np.testing.assert_allclose(found["opacities"], before.opacities[source], atol=0.501 / 255)
        sh = before.sh[source, :16].ravel()
        np.testing.assert_allclose(found["sh"][:3], sh[:3], atol=1e-6, err_msg="fewer than 256")
        np.testing.assert_allclose(found["sh"][3:], sh[3:], atol=0.02)


def test_saving_and_loading_keeps_the_scene(tmp_path: Path, rng: np.random.Generator) -> None:
    before = random_gaussians(rng, 5000, 1)
    after = io.load(io.save(tmp_path / "scene.sog", before))
    before = before.take(morton_order(before.means))
    assert np.all(np.abs(log(after.means) - log(before.means)) <= 0.51 * np.ptp(log(before.means), axis=0) / 65535)
    assert angles(after.quats, before.quats).max() < WIDEST
    np.testing.assert_allclose(after.opacities, before.opacities, atol=0.501 / 255)
    assert np.abs(np.log(after.scales / before.scales)).max() < 0.05
    assert np.abs(after.sh[:, 0] - before.sh[:, 0]).max() < 0.1
    # 4096 colours for 5000 splats.
    assert 3500 < len(np.unique(after.sh[:, 1:], axis=0)) <= 4096
    assert np.mean(np.abs(after.sh[:, 1:] - before.sh[:, 1:])) < 0.12 * np.mean(np.abs(before.sh[:, 1:]))


def test_the_file_has_the_layout_of_the_specification(tmp_path: Path, rng: np.random.Generator) -> None:
    path = io.save(tmp_path / "scene.sog", random_gaussians(rng, 300, 2))
    twin = made_up(rng, bands=2)
    scene = unpacked(path)
    assert scene.meta["version"] == 2
    assert scene.meta.items() >= {key: scene.meta[key] for key in twin.meta}.items()
    for name, field in twin.meta.items():
        if isinstance(field, dict):
            assert scene.meta[name].keys() == field.keys()
            assert scene.meta[name]["files"] == field["files"]
            assert len(scene.meta[name].get("codebook", range(256))) == 256
    assert scene.planes["means_l"].shape == (16, 20, 4), "sides are multiples of four"
    assert scene.planes["shN_centroids"].shape == (5, 64 * 8, 4)
    with zipfile.ZipFile(path) as archive:
        assert {entry.compress_type for entry in archive.infolist()} == {zipfile.ZIP_STORED}
        assert {entry.date_time[0] for entry in archive.infolist()} == {1980}, "no time is in the file"
        assert {archive.read(name)[12:16] for name in archive.namelist() if name != "meta.json"} == {b"VP8L"}


def test_the_same_scene_makes_the_same_bytes(tmp_path: Path, rng: np.random.Generator) -> None:
    scene = random_gaussians(rng, 3000, 1)
    first, second = (io.save(tmp_path / name, scene).read_bytes() for name in ("a.sog", "b.sog"))
    assert first == second


def test_a_scene_of_a_sog_is_saved_with_its_own_colours(tmp_path: Path, rng: np.random.Generator) -> None:
    first = io.load(io.save(tmp_path / "a.sog", random_gaussians(rng, 3000, 1)))
    second = io.load(io.save(tmp_path / "b.sog", first))
    again = first.take(morton_order(first.means))
    np.testing.assert_allclose(second.scales, again.scales, rtol=1e-5)
    np.testing.assert_array_equal(second.opacities, again.opacities)
    np.testing.assert_array_equal(second.sh, again.sh)
    assert np.mean(angles(second.quats, again.quats) > 0.1) < 0.05


def test_values_beyond_the_format_become_the_nearest_it_has(tmp_path: Path) -> None:
    extreme = Gaussians(
        np.array([[-1e18, 0, 1e-6], [1e18, 0, 0]], np.float32),
        np.array([[-1, 0, 0, 0], [0.5, -0.5, 0.5, -0.5]], np.float32),
        np.array([[0, 1, 1e-30], [1e38, 1, 1]], np.float32),
        np.array([0, 1], np.float32),
        np.array([[[1e37] * 3] * 4, [[-1e37] * 3] * 4], np.float32),
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        after = io.load(io.save(tmp_path / "scene.sog", extreme))
    np.testing.assert_allclose(after.means, extreme.means, rtol=1e-4, atol=1e-12)
    tiny = np.finfo(np.float32).tiny
    np.testing.assert_allclose(after.scales, np.maximum(extreme.scales, tiny), rtol=1e-4)
    assert after.opacities.tolist() == [0.0, 1.0]
    assert angles(after.quats, extreme.quats).max() < WIDEST
    np.testing.assert_allclose(after.sh[:, 0], extreme.sh[:, 0], rtol=1e-6)
    assert after.sh[:, 1:].tolist() == [[[1e4] * 3] * 3, [[-1e4] * 3] * 3]


def test_one_splat_far_off_leaves_the_others_their_precision(tmp_path: Path, rng: np.random.Generator) -> None:
    before = random_gaussians(rng, 2000, 1)
    scales, sh = before.scales.copy(), before.sh.copy()
    scales[0], sh[0] = 1e38, -1e37
    after = io.load(io.save(tmp_path / "scene.sog", replace(before, scales=scales, sh=sh)))
    order = morton_order(before.means)
    good = order != 0
    assert np.abs(np.log(after.scales[good] / before.scales[order][good])).max() < 0.05
    assert np.abs(after.sh - before.sh[order])[good].mean() < 0.05


@pytest.mark.parametrize("count", [0, 1])
def test_hardly_any_splats_are_saved(tmp_path: Path, rng: np.random.Generator, count: int) -> None:
    before = random_gaussians(rng, count, 2)
    after = io.load(io.save(tmp_path / "scene.sog", before))
    np.testing.assert_allclose(after.means, before.means, rtol=1e-6)


def test_a_scene_trained_with_antialiasing_says_so_by_both_names(tmp_path: Path, rng: np.random.Generator) -> None:
    scene = replace(random_gaussians(rng, 3), antialiased=True)
    meta = unpacked(io.save(tmp_path / "scene.sog", scene)).meta
    assert (meta["model"], meta["antialias"]) == ("antialiased", True)
    plain = unpacked(io.save(tmp_path / "plain.sog", replace(scene, antialiased=False))).meta
    assert not {"model", "antialias"} & plain.keys()


@pytest.mark.parametrize(
    ("fields", "antialiased"),
    [
        ({"antialias": True}, True),
        ({"antialias": False}, False),
        ({"antialias": 1}, False),
        ({"antialias": True, "model": "default"}, False),
        ({"antialias": False, "model": "antialiased"}, True),
    ],
)
def test_the_older_name_of_antialiasing_counts_where_there_is_no_model(
    tmp_path: Path, rng: np.random.Generator, fields: dict[str, object], antialiased: bool
) -> None:
    scene = made_up(rng)
    scene.meta |= fields
    path = tmp_path / "scene.sog"
    path.write_bytes(scene.zipped())
    assert io.load(path).antialiased is antialiased


def test_planes_beside_a_meta_json_are_not_written(tmp_path: Path, rng: np.random.Generator) -> None:
    with pytest.raises(SaveError, match=r"suffix '.json' is no format that can be written; use one of .*\.sog"):
        io.save(tmp_path / "meta.json", random_gaussians(rng, 3))


@needs_scenes
@pytest.mark.skipif(not JIT, reason="thousands of splats take minutes without a compiler")
@pytest.mark.parametrize(
    ("name", "floor"),
    [
        ("format_matrix/yashica.ply", 44.0),
        ("format_matrix/playbot31k.ply", 60.0),
        ("ply/plant.ply", 65.0),
        ("ply/academic_tarot_cards.ply", 62.0),
        ("snowmiku/trained/snow_sh3_3000.ply", 52.0),
    ],
)
def test_a_real_scene_saved_looks_the_same_and_no_worse_than_its_twin(
    tmp_path: Path, name: str, floor: float
) -> None:
    assert SCENES is not None
    truth = io.load(SCENES / name)
    path = io.save(tmp_path / "scene.sog", truth)
    image = picture(truth, truth)
    ours = psnr(picture(io.load(path), truth), image)
    assert ours >= floor, f"{ours:.1f} dB"
    twin = (SCENES / name).with_suffix(".sog")
    if twin.exists():
        assert ours >= psnr(picture(io.load(twin), truth), image)
        assert path.stat().st_size < 1.1 * twin.stat().st_size
