"""``.ksplat`` files: every level made by hand, real ones beside their PLY twins, and every way to lie."""

from __future__ import annotations

import math
import struct
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tests.io.ksplats import SH_RANGE, STEP, Part, gaussforge, ksplat
from tests.io.outcomes import within_memory
from tests.io.splat_files import SCENES, apart, in_bytes, likeness, needs_scenes
from tests.scenes import random_gaussians
from tsplat import io
from tsplat.errors import CorruptFileError, LoadError, LoadWarning
from tsplat.importance import importance
from tsplat.scene import SH_C0, Gaussians

HARMONIC_ERROR = (1e-7, 1e-3, (SH_RANGE[1] - SH_RANGE[0]) / 255 * 1.001)
"""Of a coefficient from -2 to 1 at each level; the last one is rounded down."""


def load_bytes(folder: Path, raw: bytes, **options: int) -> Gaussians:
    path = folder / "scene.ksplat"
    path.write_bytes(raw)
    return io.load(path, **options)  # type: ignore[arg-type]


def patched(raw: bytes, offset: int, code: str, *values: float) -> bytes:
    copy = bytearray(raw)
    struct.pack_into(code, copy, offset, *values)
    return bytes(copy)


def small(level: int = 1, sh_degree: int = 1, count: int = 7) -> bytes:
    return ksplat(level, [Part(random_gaussians(np.random.default_rng(5), count, sh_degree), 4, (2, 1))])


def check(found: Gaussians, truth: Gaussians, level: int) -> None:
    exact = 1e-6 if level == 0 else 1e-3
    np.testing.assert_allclose(found.means, truth.means, atol=0.51 * STEP if level else 0.0)
    np.testing.assert_allclose(found.scales, truth.scales, rtol=exact)
    assert apart(found.quats, truth.quats) < 2 * exact
    np.testing.assert_allclose(found.opacities, truth.opacities, atol=0.501 / 255)
    colors = [0.5 + SH_C0 * scene.sh[:, 0] for scene in (found, truth)]
    np.testing.assert_allclose(colors[0], np.clip(colors[1], 0, 1), atol=0.501 / 255)
    rest = truth.sh[:, 1:] if level < 2 else np.clip(truth.sh[:, 1:], *SH_RANGE)
    np.testing.assert_allclose(found.sh[:, 1:], rest, atol=HARMONIC_ERROR[level])


@pytest.mark.parametrize("level", [0, 1, 2])
@pytest.mark.parametrize("sh_degree", range(4))
def test_every_level_and_degree_means_what_was_packed(
    tmp_path: Path, rng: np.random.Generator, level: int, sh_degree: int
) -> None:
    truth = random_gaussians(rng, 23, sh_degree)
    found = load_bytes(tmp_path, ksplat(level, [Part(truth, 5, (4, 1, 3))]))
    assert found.sh_degree == sh_degree
    check(found, truth, level)


@pytest.mark.parametrize("level", [0, 1, 2])
def test_sections_follow_each_other_each_with_its_buckets_and_its_degree(
    tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch, level: int
) -> None:
    monkeypatch.setattr("tsplat.io.arrays.CHUNK", 3)
    scenes = [random_gaussians(rng, count, degree) for count, degree in ((8, 1), (11, 2), (1, 0))]
    parts = [Part(scenes[0], 4), Part(scenes[1], 3, (2,)), Part(scenes[2], 256, (1,))]
    found = load_bytes(tmp_path, ksplat(level, parts, room=2))
    assert (len(found), found.sh_degree) == (20, 2)
    for truth, first in zip(scenes, (0, 8, 19), strict=True):
        k = truth.sh.shape[1]
        part = found.take(range(first, first + len(truth)))
        assert not part.sh[:, k:].any()
        check(Gaussians(part.means, part.quats, part.scales, part.opacities, part.sh[:, :k]), truth, level)


@pytest.mark.parametrize("sh_degree", range(4))
def test_files_of_gaussforge_have_their_harmonics_by_channel(
    tmp_path: Path, rng: np.random.Generator, sh_degree: int
) -> None:
    truth = random_gaussians(rng, 3, sh_degree)
    found = load_bytes(tmp_path, gaussforge(truth))
    np.testing.assert_array_equal(found.sh[:, 1:], truth.sh[:, 1:])


def test_only_uncompressed_files_are_taken_for_those_of_gaussforge(tmp_path: Path) -> None:
    whole = small(1, 2)
    found = load_bytes(tmp_path, patched(whole, 12, "<I", 0))
    np.testing.assert_array_equal(found.sh, load_bytes(tmp_path, whole).sh)


def test_what_a_file_leaves_open_is_what_the_viewer_takes(tmp_path: Path, rng: np.random.Generator) -> None:
    # No steps are written by hand either: 32767. No range of harmonics is -1.5 to 1.5.
    whole = ksplat(2, [Part(random_gaussians(rng, 1, 1), 1)])
    record = len(whole) - 33
    raw = patched(patched(whole, 36, "<2f", 0.0, 0.0), record + 24, "<9B", *([0] * 8), 255)
    found = load_bytes(tmp_path, raw)
    np.testing.assert_allclose(found.sh[0, 1:].T.ravel(), [-1.5] * 8 + [1.5], atol=1e-6)


def test_steps_that_a_section_names_are_used(tmp_path: Path) -> None:
    raw = ksplat(1, [Part(random_gaussians(np.random.default_rng(5), 1, 0), 1)])
    center = np.frombuffer(raw, "<f4", 3, 5120)
    raw = patched(patched(raw, 4096 + 24, "<I", 100), 5120 + 12, "<3H", 0, 100, 200)
    np.testing.assert_allclose(load_bytes(tmp_path, raw).means[0] - center, [-4.0, 0.0, 4.0], atol=1e-5)


@pytest.mark.parametrize("level", [0, 2])
def test_a_file_cut_anywhere_is_refused(tmp_path: Path, level: int) -> None:
    whole = small(level)
    assert len(load_bytes(tmp_path, whole)) == 7
    for length in range(1, len(whole)):
        with pytest.raises(CorruptFileError, match=r"scene\.ksplat: at byte \d+: .*; fetch it again"):
            load_bytes(tmp_path, whole[:length])


LIARS: dict[str, tuple[int, str, float, str]] = {
    "major version": (0, "<B", 1, "at byte 0: version 1.1, expected 0.1; convert it"),
    "minor version": (1, "<B", 0, "at byte 0: version 0.0, expected 0.1; convert it"),
    "level": (20, "<H", 3, "at byte 20: compression level 3, expected 0, 1 or 2"),
    "many sections": (4, "<I", 2**32 - 1, "at byte 4: sections: 4294967295 need 4398046514176 bytes"),
    "no sections": (4, "<I", 0, "at byte 16: splats: 7, expected 0 as the sections hold"),
    "one splat too many": (16, "<I", 8, "at byte 16: splats: 8, expected 7"),
    "many splats": (4096, "<2I", 2**32 - 1, r"at byte 4096: section: ends at byte \d+, expected at most 5"),
    "more than most": (4096, "<I", 8, "at byte 4096: section: 8 splats, expected at most its largest number, 7"),
    "many buckets": (4096 + 12, "<I", 2**32 - 1, "ends at byte"),
    "many partial buckets": (4096 + 36, "<I", 2**32 - 1, "buckets: 1 full and 4294967295 other"),
    "too few buckets": (4096 + 12, "<I", 2, "at byte 4128: buckets: 1 full and 2 other ones, expected at most 2"),
    "small buckets": (4096 + 8, "<I", 3, "at byte 5120: buckets: hold 6 splats, expected 7"),
    "short partial bucket": (5120, "<I", 0, "buckets: hold 5 splats, expected 7"),
    "bucket bytes": (4096 + 20, "<H", 11, "at byte 4116: bucket of 11 bytes, expected 12"),
    "flat block": (4096 + 16, "<f", 0.0, "at byte 4112: block of size 0, expected a length above 0"),
    "nan block": (4096 + 16, "<f", math.nan, "block of size nan"),
    "sh degree": (4096 + 40, "<H", 4, "at byte 4136: sh degree 4, expected 0 to 3"),
    "larger sh degree": (4096 + 40, "<H", 3, "ends at byte"),
    "negative scale": (5120 + 8 + 36 + 42 * 2 + 8, "<e", -0.5, r"at byte 5248: scale of splat 2: -0\.5, expected"),
}


@pytest.mark.parametrize("name", LIARS)
def test_a_header_that_lies_is_one_clear_line(tmp_path: Path, name: str) -> None:
    offset, code, value, message = LIARS[name]
    values = [value] * (2 if "2" in code else 1)
    with pytest.raises(LoadError, match=message) as caught:
        load_bytes(tmp_path, patched(small(), offset, code, *values))
    assert "\n" not in str(caught.value)


def test_buckets_of_no_splats_take_no_room(tmp_path: Path) -> None:
    # Buckets of no bytes fit into any file.
    raw = patched(patched(small(), 16, "<I", 0), 4096, "<4I", 0, 0, 4, 2**32 - 1)
    raw = patched(patched(raw, 4096 + 20, "<H", 0), 4096 + 32, "<2I", 2**32 - 1, 0)
    path = tmp_path / "scene.ksplat"
    path.write_bytes(raw[:5120])
    gaussians = within_memory(path, 0)
    assert gaussians is not None
    assert len(gaussians) == 0


def test_harmonics_in_bytes_need_a_range_of_numbers(tmp_path: Path) -> None:
    with pytest.raises(CorruptFileError, match="at byte 36: harmonics: range inf to 1, expected numbers"):
        load_bytes(tmp_path, patched(small(2), 36, "<f", math.inf))
    assert len(load_bytes(tmp_path, patched(small(1), 36, "<f", math.inf))) == 7


def test_a_file_that_shrinks_while_it_is_read_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tsplat.io.arrays.CHUNK", 10)
    path = tmp_path / "scene.ksplat"
    path.write_bytes(ksplat(0, [Part(random_gaussians(np.random.default_rng(5), 1000, 0))]))

    def cut(_: float) -> None:
        with path.open("r+b") as file:
            file.truncate(5120 + 44 * 505)

    with pytest.raises(CorruptFileError, match="contents: end after 220 bytes, expected 440; fetch it again"):
        io.load(path, progress=cut)


def test_a_file_that_shrinks_before_its_sections_are_read_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = small()
    monkeypatch.setattr("tsplat.io.ksplat_header.os.fstat", lambda _: SimpleNamespace(st_size=len(whole)))
    with pytest.raises(CorruptFileError, match="at byte 4096: section: header of 904 bytes, expected 1024"):
        load_bytes(tmp_path, whole[:5000])


def test_what_cannot_be_drawn_is_left_out_and_counted(tmp_path: Path) -> None:
    first = 5120 + 8 + 36
    raw = patched(small(), first + 6, "<e", math.inf)
    raw = patched(raw, first + 42 + 12, "<4e", 0, 0, 0, 0)
    raw = patched(raw, first + 84 + 24, "<e", math.nan)
    with pytest.warns(LoadWarning, match=r"scene\.ksplat: dropped 3 of 7 splats") as caught:
        assert len(load_bytes(tmp_path, raw)) == 4
    assert caught[0].filename == __file__, "the warning points at the caller of load"


def test_a_limit_keeps_the_weightiest_in_file_order(tmp_path: Path, rng: np.random.Generator) -> None:
    raw = ksplat(1, [Part(random_gaussians(rng, 40, 0))])
    whole = load_bytes(tmp_path, raw)
    best = np.sort(np.argsort(-importance(whole.scales, whole.opacities), kind="stable")[:7])
    np.testing.assert_array_equal(load_bytes(tmp_path, raw, max_splats=7).means, whole.means[best])


def test_progress_grows_to_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tsplat.io.arrays.CHUNK", 3)
    path = tmp_path / "scene.ksplat"
    seen: list[float] = []
    path.write_bytes(small(count=11))
    io.load(path, progress=seen.append)
    assert seen == [3 / 11, 6 / 11, 9 / 11, 1.0]


@needs_scenes
@pytest.mark.parametrize(("name", "sh_degree"), [("yashica", 3), ("playbot31k", 2)])
def test_real_files_agree_with_their_ply_twins(name: str, sh_degree: int) -> None:
    assert SCENES is not None
    found = io.load(SCENES / "format_matrix" / f"{name}.ksplat")
    truth = in_bytes(io.load(SCENES / "format_matrix" / f"{name}.ply"), sh_degree)
    np.testing.assert_array_equal(found.means, truth.means)
    np.testing.assert_array_equal(found.sh[:, 1:], truth.sh[:, 1:])
    np.testing.assert_allclose(found.scales, truth.scales, rtol=1e-6)
    np.testing.assert_allclose(found.opacities, truth.opacities, atol=1.01 / 255)  # its writer rounds down
    np.testing.assert_allclose(found.sh[:, 0], truth.sh[:, 0], atol=1.01 / 255 / SH_C0)
    assert apart(found.quats, truth.quats) < 1e-5
    assert likeness(found, truth) > 55.0


@needs_scenes
def test_the_smallest_real_file_has_four_splats_in_a_bucket() -> None:
    assert SCENES is not None
    folder = SCENES / "splat-transform-fixtures" / "test" / "fixtures" / "splat"
    found, truth = io.load(folder / "minimal.ksplat"), io.load(folder / "minimal.splat")
    for name in ("means", "quats", "scales", "opacities", "sh"):
        np.testing.assert_allclose(getattr(found, name), getattr(truth, name), atol=2e-4, err_msg=name)
