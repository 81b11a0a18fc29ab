"""SPZ files that are written: read by the slow twin, by the reader, and byte for byte like another writer's."""

from __future__ import annotations

import gzip
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.io.alike import angles, matrix, picture
from tests.io.spzs import decoded, unpacked
from tests.raster.compare import psnr
from tests.scenes import random_gaussians, shared_scenes
from tsplat import io
from tsplat.errors import SaveError, SaveWarning
from tsplat.scene import Gaussians

SCENES = shared_scenes()
needs_scenes = pytest.mark.skipif(
    SCENES is None, reason="no folder of real scenes: set TSPLAT_SCENES or have ../shared/scenes"
)


def made_up_for(opacities: Any, scales: Any, kept: Any) -> Any:
    """Return opacities that show as much with the scales kept as they did with those before."""

    def area(x: Any) -> Any:
        return x[..., 0] * x[..., 1] + x[..., 1] * x[..., 2] + x[..., 2] * x[..., 0]

    return np.minimum(opacities * area(np.float64(scales)) / area(np.float64(kept)), 1.0)


@pytest.mark.parametrize("degree", range(4))
def test_saving_writes_what_the_slow_reader_reads(tmp_path: Path, rng: np.random.Generator, degree: int) -> None:
    before = random_gaussians(rng, 50, degree)
    raw = gzip.decompress(io.save(tmp_path / "scene.spz", before).read_bytes())
    first, splats = unpacked(raw)
    assert first[:3] == (3, 50, degree)
    assert first[4:] == (0, 0)
    half_turn = np.array([1, -1, -1])
    for index, splat in enumerate(splats):
        found = decoded(splat, 3, first[3])
        np.testing.assert_allclose(found["means"], before.means[index] * half_turn, atol=0.5001 / 2 ** first[3])
        np.testing.assert_allclose(np.log(found["scales"]), np.log(before.scales[index]), atol=0.5001 / 16)
        opacity = made_up_for(before.opacities[index], before.scales[index], np.array(found["scales"]))
        np.testing.assert_allclose(found["opacities"], opacity, atol=0.5001 / 255)
        turned = np.diag(half_turn) @ matrix(before.quats[index]) @ np.diag(half_turn)
        np.testing.assert_allclose(matrix(np.array(found["quats"], np.float32)), turned, atol=0.006)


def test_saving_and_loading_keeps_the_scene(tmp_path: Path, rng: np.random.Generator) -> None:
    before = random_gaussians(rng, 70_000, 1)
    after = io.load(io.save(tmp_path / "scene.spz", before))
    np.testing.assert_allclose(after.means, before.means, atol=0.5001 / 2**16)
    np.testing.assert_allclose(np.log(after.scales), np.log(before.scales), atol=0.5001 / 16)
    assert angles(after.quats, before.quats).max() < 0.25
    opacities = made_up_for(before.opacities, before.scales, after.scales)
    held = (before.sh[:, 0] < 10 / 3).all(1)
    np.testing.assert_allclose(after.opacities[held], opacities[held], atol=0.5001 / 255)
    np.testing.assert_allclose(after.sh[:, 0], np.clip(before.sh[:, 0], -10 / 3, 10 / 3), atol=0.5001 / 255 / 0.15)
    # A byte goes from -1 to 127/128 in the axes of the file, so one end of the two is a step short.
    inside = np.abs(before.sh[:, 1:]) < 127 / 128
    assert 0.99 < inside.mean() < 1.0
    np.testing.assert_allclose(after.sh[:, 1:][inside], before.sh[:, 1:][inside], atol=0.5001 / 128)
    assert np.abs(after.sh[:, 1:][~inside]).min() >= 127 / 128


def test_the_same_scene_makes_the_same_bytes(tmp_path: Path, rng: np.random.Generator) -> None:
    scene = random_gaussians(rng, 20, 3)
    first, second = (io.save(tmp_path / name, scene).read_bytes() for name in ("a.spz", "b.spz"))
    assert first == second
    assert first[3:8] == bytes(5), "neither a name nor a time is in the file"
    again = io.save(tmp_path / "c.spz", io.load(tmp_path / "a.spz")).read_bytes()
    assert gzip.decompress(again) == gzip.decompress(first)


def test_values_beyond_the_format_become_the_nearest_it_has(tmp_path: Path) -> None:
    extreme = Gaussians(
        np.zeros((2, 3), np.float32),
        np.array([[-1, 0, 0, 0], [0.5, -0.5, 0.5, -0.5]], np.float32),
        np.array([[0, 1, 1e-30], [1e30, 1, 1]], np.float32),
        np.array([0, 1], np.float32),
        np.array([[[3e38] * 3] * 4, [[-3e38] * 3] * 4], np.float32),
    )
    with pytest.warns(SaveWarning, match="have (a sigma outside|harmonics beyond)"):
        after = io.load(io.save(tmp_path / "scene.spz", extreme))
    low, high = math.exp(-10), math.exp(255 / 16 - 10)
    np.testing.assert_allclose(after.scales, np.array([[low, 1, low], [high, 1, 1]]), rtol=1e-5)
    assert after.opacities.tolist() == [0.0, 1.0]
    assert angles(after.quats, extreme.quats).max() < 0.25
    np.testing.assert_allclose(after.sh[:, 0], np.array([[1] * 3, [-1] * 3]) * 10 / 3, rtol=1e-6)
    assert np.sign(after.sh).tolist() == np.sign(extreme.sh).tolist()
    assert np.unique(np.abs(after.sh[:, 1:])).tolist() == [127 / 128, 1.0]


@pytest.mark.parametrize("reach", [0.0, 1e-30, 1e-3, 1.0, 15.9, 100.0, 2047.9999, 2048.0, 1e6, 8388607.0])
def test_means_take_as_many_bits_as_they_need(tmp_path: Path, rng: np.random.Generator, reach: float) -> None:
    scene = random_gaussians(rng, 3, 0)
    means = np.array([[reach, 0, 0], [0, -reach, reach / 3], [0, 0, -reach]], np.float32)
    scene = Gaussians(means, scene.quats, scene.scales, scene.opacities, scene.sh)
    after = io.load(io.save(tmp_path / "scene.spz", scene))
    step = 2.0**-24 if reach < 0.01 else max(2.0**-16 * reach, 2.0**-12 if reach > 1 else 0.0)
    np.testing.assert_allclose(after.means, means, rtol=0, atol=0.51 * step)


@pytest.mark.parametrize("reach", [8388608.0, 3e38])
def test_a_mean_too_far_out_is_a_save_error(tmp_path: Path, rng: np.random.Generator, reach: float) -> None:
    scene = random_gaussians(rng, 1, 0)
    far = Gaussians(np.full((1, 3), reach, np.float32), scene.quats, scene.scales, scene.opacities, scene.sh)
    with pytest.raises(SaveError, match=r"an SPZ holds up to 8388607; save as \.ply"):
        io.save(tmp_path / "scene.spz", far)
    assert list(tmp_path.iterdir()) == []


def test_an_empty_scene_is_saved(tmp_path: Path, rng: np.random.Generator) -> None:
    assert len(io.load(io.save(tmp_path / "scene.spz", random_gaussians(rng, 0, 2)))) == 0


@needs_scenes
def test_the_scene_of_another_writer_is_written_with_the_same_bytes(tmp_path: Path) -> None:
    assert SCENES is not None
    path = SCENES / "format_matrix" / "yashica_v3.spz"
    before = io.load(path)
    ours = gzip.decompress(io.save(tmp_path / "scene.spz", before).read_bytes())
    theirs = gzip.decompress(path.read_bytes())
    assert len(ours) == len(theirs)
    quats = slice(16 + 16 * 8192, 16 + 20 * 8192)
    assert (ours[: quats.start], ours[quats.stop :]) == (theirs[: quats.start], theirs[quats.stop :])
    # Where two components are the largest alike, each is as good to leave out; 0 and -0 are one number.
    pairs = zip(unpacked(ours)[1], unpacked(theirs)[1], strict=True)
    apart = [index for index, (our, their) in enumerate(pairs) if our.quat != their.quat]
    assert len(apart) < 20
    two = np.sort(np.abs(before.quats[apart]), axis=1)[:, 2:]
    np.testing.assert_allclose(two[:, 0], two[:, 1], atol=1.5 / 511)


@needs_scenes
@pytest.mark.parametrize(("twin", "whole"), [("yashica.ply", 40.0), ("playbot31k.ply", 53.0)])
def test_a_real_scene_saved_looks_the_same(tmp_path: Path, twin: str, whole: float) -> None:
    assert SCENES is not None
    truth = io.load(SCENES / "format_matrix" / twin)
    after = io.load(io.save(tmp_path / "scene.spz", truth))
    images = (np.clip(picture(scene, truth), 0.0, 1.0) for scene in (after, truth))
    assert psnr(*images) >= whole


def test_a_splat_too_bright_for_a_byte_covers_more_instead(tmp_path: Path, rng: np.random.Generator) -> None:
    scene = random_gaussians(rng, 30, 0)
    sh = np.zeros_like(scene.sh)
    sh[:15] = 5.0
    bright = Gaussians(scene.means, scene.quats, scene.scales, 0.3 * scene.opacities, sh)
    after = io.load(io.save(tmp_path / "scene.spz", bright))
    expected = made_up_for(bright.opacities, bright.scales, after.scales)
    light, most = 0.28209479 * 5.0, 0.28209479 * 10 / 3  # beyond a grey of 0.5
    expected[:15] *= light / most
    np.testing.assert_allclose(after.opacities, np.minimum(expected, 1.0), atol=0.5001 / 255)


def test_a_scene_that_an_spz_held_is_saved_as_it_was(tmp_path: Path, rng: np.random.Generator) -> None:
    once = io.save(tmp_path / "once.spz", random_gaussians(rng, 200, 2))
    assert io.save(tmp_path / "twice.spz", io.load(once)).read_bytes() == once.read_bytes()
