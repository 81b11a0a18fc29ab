"""``.splat`` files: records made by hand, real ones beside their PLY twins, and bytes that are none."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tests.io.splat_files import SCENES, apart, in_bytes, likeness, needs_scenes
from tests.io.splats import record
from tests.scenes import random_gaussians
from tsplat import io
from tsplat.errors import CorruptFileError, LoadWarning, SaveWarning
from tsplat.importance import importance
from tsplat.scene import SH_C0, Gaussians


def load_bytes(folder: Path, raw: bytes, name: str = "scene.splat") -> Gaussians:
    path = folder / name
    path.write_bytes(raw)
    return io.load(path)


def test_a_record_made_by_hand_is_read_field_by_field(tmp_path: Path) -> None:
    raw = record(means=(1.0, -2.5, 3.0), scales=(0.5, 0.0, 8.0), rgba=(255, 0, 51, 204), quats=(128, 128, 64, 128))
    gaussians = load_bytes(tmp_path, record() + raw, "SCENE.SPLAT")
    assert gaussians.sh.shape == (2, 1, 3)
    assert gaussians.means[1].tolist() == [1.0, -2.5, 3.0]
    assert gaussians.scales[1].tolist() == [0.5, 0.0, 8.0]
    assert gaussians.quats.tolist() == [[1, 0, 0, 0], [0, 0, -1, 0]]
    np.testing.assert_allclose(gaussians.opacities, [1.0, 0.8], atol=1e-7)
    np.testing.assert_allclose(0.5 + math.sqrt(1 / (4 * math.pi)) * gaussians.sh[1, 0], [1.0, 0.0, 0.2], atol=1e-6)


def test_a_quat_is_wxyz_about_128(tmp_path: Path) -> None:
    raw = b"".join(record(quats=tuple(128 + 100 * (axis == i) for i in range(4))) for axis in range(4))
    np.testing.assert_array_equal(load_bytes(tmp_path, raw).quats, np.eye(4))


def test_chunks_join_without_a_seam(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tsplat.io.arrays.CHUNK", 3)
    gaussians = random_gaussians(np.random.default_rng(2), 10, 0)
    seen: list[float] = []
    found = io.load(io.save(tmp_path / "scene.splat", gaussians), progress=seen.append)
    np.testing.assert_array_equal(found.means, gaussians.means)
    assert apart(found.quats, gaussians.quats) < 0.03
    assert seen == [0.3, 0.6, 0.9, 1.0]


def test_a_file_cut_inside_a_record_is_refused(tmp_path: Path) -> None:
    whole = record() + record(means=(1.0, 0.0, 0.0))
    assert len(load_bytes(tmp_path, whole)) == 2
    for length in range(1, len(whole)):
        if length == len(record()):
            assert len(load_bytes(tmp_path, whole[:length])) == 1, "no header says how many there were"
            continue
        with pytest.raises(CorruptFileError, match=rf"size: {length} bytes, expected a multiple of 32; fetch it"):
            load_bytes(tmp_path, whole[:length])


def test_a_file_that_shrinks_while_it_is_read_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tsplat.io.arrays.CHUNK", 1000)
    path = tmp_path / "scene.splat"
    path.write_bytes(record() * 100_000)

    def cut(_: float) -> None:
        with path.open("r+b") as file:
            file.truncate(32 * 50_500)

    with pytest.raises(CorruptFileError, match="records: ends after 50500, expected 100000"):
        io.load(path, progress=cut)


def test_a_negative_scale_is_named_with_its_splat_and_place(tmp_path: Path) -> None:
    raw = record() * 5 + record(scales=(1.0, -0.25, 1.0)) + record()
    with pytest.raises(CorruptFileError, match=r"at byte 160: scale of splat 5: -0\.25, expected 0 or more"):
        load_bytes(tmp_path, raw)


def test_what_cannot_be_drawn_is_left_out_and_counted(tmp_path: Path) -> None:
    broken = record(means=(math.nan, 0, 0)) + record(scales=(math.inf, 1, 1)) + record(quats=(128, 128, 128, 128))
    with pytest.warns(LoadWarning, match=r"scene\.splat: dropped 3 of 5 splats") as caught:
        assert len(load_bytes(tmp_path, record() + broken + record())) == 2
    assert caught[0].filename == __file__, "the warning points at the caller of load"


def test_a_limit_keeps_the_weightiest_in_file_order(tmp_path: Path, rng: np.random.Generator) -> None:
    path = io.save(tmp_path / "scene.splat", in_bytes(random_gaussians(rng, 40, 0), 0))
    whole = io.load(path)
    best = np.sort(np.argsort(-importance(whole.scales, whole.opacities), kind="stable")[:7])
    np.testing.assert_array_equal(io.load(path, max_splats=7).means, whole.means[best])


def test_saving_keeps_the_scene_to_the_nearest_byte(tmp_path: Path, rng: np.random.Generator) -> None:
    before = random_gaussians(rng, 9001, 2)
    with pytest.warns(SaveWarning, match="colours"):
        path = io.save(tmp_path / "scene.splat", before)
    assert path.stat().st_size == 32 * 9001
    after = io.load(path)
    np.testing.assert_array_equal(after.means, before.means)
    np.testing.assert_array_equal(after.scales, before.scales)
    np.testing.assert_allclose(after.opacities, before.opacities, atol=0.501 / 255)
    colors = [0.5 + SH_C0 * scene.sh[:, 0] for scene in (after, before)]
    np.testing.assert_allclose(colors[0], np.clip(colors[1], 0, 1), atol=0.501 / 255)
    assert apart(after.quats, before.quats) < 2 * math.sqrt(4) * 0.75 / 128
    assert likeness(after, in_bytes(before, 0)) > 40.0


def test_saving_writes_the_record_as_it_is_known(tmp_path: Path) -> None:
    scene = Gaussians(
        np.array([[1.0, 2.0, 3.0]]),
        np.array([[0.5, -0.5, 0.5, -0.5]]),
        np.array([[0.1, 0.2, 0.3]]),
        np.array([0.6]),
        np.array([[[9.0, -9.0, 0.0]]]),
    )
    with pytest.warns(SaveWarning, match="1 of 1 splats have colours outside of 0 to 1, and were cut to that"):
        raw = io.save(tmp_path / "scene.splat", scene).read_bytes()
    known = record(means=(1, 2, 3), scales=(0.1, 0.2, 0.3), rgba=(255, 0, 128, 153), quats=(192, 64, 192, 64))
    assert raw == known


@needs_scenes
@pytest.mark.parametrize("name", ["yashica", "playbot31k"])
def test_real_files_agree_with_their_ply_twins(name: str) -> None:
    assert SCENES is not None
    found = io.load(SCENES / "format_matrix" / f"{name}.splat")
    truth = io.load(SCENES / "format_matrix" / f"{name}.ply")
    np.testing.assert_array_equal(found.means, truth.means)
    np.testing.assert_allclose(found.scales, truth.scales, rtol=3e-7)
    np.testing.assert_allclose(found.opacities, truth.opacities, atol=1.01 / 255)  # its writer rounds down
    colors = [0.5 + SH_C0 * scene.sh[:, 0] for scene in (found, truth)]
    np.testing.assert_allclose(colors[0], np.clip(colors[1], 0, 1), atol=1.01 / 255)
    assert apart(found.quats, truth.quats) < 2 * math.sqrt(4) * 0.75 / 128
    assert likeness(found, in_bytes(truth, 0)) > 42.0


@needs_scenes
def test_the_smallest_real_file_has_four_splats() -> None:
    assert SCENES is not None
    path = SCENES / "splat-transform-fixtures" / "test" / "fixtures" / "splat" / "minimal.splat"
    found = io.load(path)
    assert found.means.tolist() == [[-1, 0, -1], [0, 0, -1], [-1, 0, 0], [0, 0, 0]]
    np.testing.assert_allclose(found.scales, 0.1)
    np.testing.assert_allclose(found.opacities, 230 / 255, atol=1e-6)
    assert found.quats.tolist() == [[0, 0, 0, 1]] * 4


@needs_scenes
@pytest.mark.parametrize("name", ["yashica", "playbot31k"])
def test_saving_a_real_scene_keeps_its_picture(tmp_path: Path, name: str) -> None:
    assert SCENES is not None
    truth = in_bytes(io.load(SCENES / "format_matrix" / f"{name}.ply"), 0)
    assert likeness(io.load(io.save(tmp_path / "scene.splat", truth)), truth) > 40.0
