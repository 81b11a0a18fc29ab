"""What is written as a .tsplat comes back; what is no such file, or lies about itself, is refused in one line."""

from __future__ import annotations

import gc
import io
import os
import struct
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.scenes import random_gaussians
from tsplat.errors import CorruptFileError, LoadError, SaveError
from tsplat.io import load, save
from tsplat.io.tsplat_file import write
from tsplat.io.tsplat_header import HEADER, SECTION, Counts, Header, packed, parse
from tsplat.io.tsplat_map import Opened, is_tsplat, open_file, open_mapped

COUNTS = Counts(splats=300, blocks=3, coefficients=3, sampled=9)
NAMES = tuple(COUNTS.arrays)


def plausible() -> dict[str, list[Any]]:
    rng, arrays = np.random.default_rng(1), COUNTS.arrays.items()
    made = {name: [rng.uniform(0.1, 0.9, length).astype(dtype)] for name, (dtype, length) in arrays}
    for name in ("quats", "sample_quats"):
        made[name][0].reshape(-1, 4)[:] /= np.linalg.norm(made[name][0].reshape(-1, 4), axis=1, keepdims=True)
    return made


@pytest.fixture(scope="module")
def whole() -> bytes:
    """Return a file whose arrays are plausible, though no scene's."""
    file = io.BytesIO()
    write(file, COUNTS, True, plausible())
    return file.getvalue()


@pytest.fixture
def path(tmp_path: Path, whole: bytes) -> Path:
    path = tmp_path / "x.tsplat"
    path.write_bytes(whole)
    return path


def with_right_checksum(raw: bytes) -> bytes:
    """Return a file whose header was changed as if its writer had meant it."""
    sections = struct.unpack_from("<I", raw, 44)[0]
    end = HEADER.size + sections * SECTION.size
    checksum = zlib.crc32(raw[:60] + bytes(4) + raw[64:end])
    return raw[:60] + struct.pack("<I", checksum) + raw[64:]


def changed(raw: bytes, offset: int, layout: str, value: int) -> bytes:
    size = struct.calcsize(layout)
    return with_right_checksum(raw[:offset] + struct.pack(layout, value) + raw[offset + size :])


def test_every_array_is_mapped_where_it_was_written(path: Path, whole: bytes) -> None:
    mapped = open_mapped(path)
    for name, section in mapped.header.sections.items():
        raw = whole[section.offset : section.offset + section.nbytes]
        assert mapped.arrays[name].tobytes() == raw
        assert section.offset % 4096 == 0
        assert section.checksum == zlib.crc32(raw)


def test_kernels_take_mapped_arrays_for_any_others(path: Path) -> None:
    for array in open_mapped(path).arrays.values():
        assert type(array) is np.ndarray
        assert not array.flags.writeable
        assert array.flags.aligned
        assert array.ctypes.data % 64 == 0


def test_the_mapping_lasts_as_long_as_an_array(path: Path, whole: bytes) -> None:
    array = open_mapped(path).arrays["means"]
    path.unlink()
    assert array.tobytes() in whole


def test_loading_gives_the_finest_level(path: Path) -> None:
    mapped, scene = open_mapped(path), load(path)
    assert len(scene) == COUNTS.splats
    assert scene.antialiased
    for i in (0, 7, 8, 255, 256, 299):
        np.testing.assert_array_equal(scene.means[i], mapped.arrays["means"][i :: COUNTS.padded])
        np.testing.assert_array_equal(scene.quats[i], mapped.arrays["quats"][4 * i : 4 * i + 4])
        np.testing.assert_array_equal(scene.sh[i, 0], mapped.arrays["sh_first"][3 * i : 3 * i + 3])
        for k in range(3):
            for channel in range(3):
                at = i // 8 * 72 + k * 24 + channel * 8 + i % 8
                half = mapped.arrays["sh_rest"].view(np.float16)[at]
                assert scene.sh[i, 1 + k, channel] == np.float32(half)


def test_fewer_are_the_weightiest(path: Path) -> None:
    scene = load(path)
    few = load(path, max_splats=20)
    weights = scene.opacities * (scene.scales * np.roll(scene.scales, 1, 1)).sum(1)
    assert set(few.opacities) == set(scene.opacities[np.argsort(-weights)[:20]])


def test_the_progress_of_loading_grows_to_its_end(path: Path) -> None:
    heard: list[float] = []
    load(path, progress=heard.append)
    assert heard == sorted(heard)
    assert heard[-1] == 1.0


def test_it_is_known_by_its_first_bytes(path: Path, tmp_path: Path) -> None:
    other = tmp_path / "x.ply"
    path.replace(other)
    assert is_tsplat(other)
    assert len(load(other)) == COUNTS.splats
    assert not is_tsplat(tmp_path / "none")
    assert not is_tsplat(tmp_path)


@pytest.mark.parametrize("name", NAMES)
def test_a_byte_that_changed_is_found_when_all_is_read(path: Path, whole: bytes, name: str) -> None:
    section = open_mapped(path).header.sections[name]
    raw = bytearray(whole)
    raw[section.offset + section.nbytes // 2] ^= 1
    path.write_bytes(raw)
    open_mapped(path)
    with pytest.raises(CorruptFileError, match=f"{name}.*checksum") as caught:
        load(path)
    assert caught.value.offset == section.offset


@pytest.mark.parametrize("keep", [0, 7, 8, 63, 64, 65, 500, 743, 744, 4096, 5000, -1])
def test_a_file_that_ends_early_is_refused_on_opening(path: Path, whole: bytes, keep: int) -> None:
    path.write_bytes(whole[:keep])
    with pytest.raises(CorruptFileError):
        open_mapped(path)


def test_a_file_that_was_not_finished_is_refused(path: Path, whole: bytes) -> None:
    path.write_bytes(bytes(744) + whole[744:])
    with pytest.raises(CorruptFileError, match="begins with"):
        open_mapped(path)


@pytest.mark.parametrize("bit", range(0, 744 * 8, 37))
def test_no_bit_of_the_header_may_change(path: Path, whole: bytes, bit: int) -> None:
    raw = bytearray(whole)
    raw[bit // 8] ^= 1 << bit % 8
    path.write_bytes(raw)
    with pytest.raises(LoadError):
        open_mapped(path)


def test_another_version_says_what_to_do(path: Path, whole: bytes) -> None:
    path.write_bytes(changed(whole, 8, "<I", 1))
    with pytest.raises(LoadError, match="version 1, expected 2; make it again"):
        open_mapped(path)


LIES = [
    (12, "<I", 128, "blocks of 128"),
    (16, "<Q", 0, "0 splats"),
    (16, "<Q", 3 * 256 + 1, "769 splats in 3 blocks"),
    (16, "<Q", 2**64 - 1, "splats in 3 blocks"),
    (16, "<Q", 299, "'quats' of 4800 bytes, expected 4784"),
    (24, "<Q", 2**63, "'bounds' of"),
    (24, "<Q", 4, "'bounds' of 60 bytes, expected 80"),
    (32, "<I", 5, "5 harmonics"),
    (32, "<I", 8, "'sh_rest' of"),
    (36, "<I", 2, "flags 0x2"),
    (40, "<I", 0, "0 splats in its sample"),
    (40, "<I", 301, "301 splats in its sample"),
    (44, "<I", 15, "no section"),
    (44, "<I", 65, "65 sections"),
    (44, "<I", 2**32 - 1, "sections"),
    (64, "<Q", 0, "no section 'sample_means'"),
    (64 + 16, "<Q", 0, "at byte 0, expected 744 or more"),
    (64 + 16, "<Q", 4097, "multiple of 64"),
    (64 + 16, "<Q", 2**64 - 64, "but ends at"),
    (64 + 24, "<Q", 2**64 - 1, "but ends at"),
    (64 + 24, "<Q", 64, "'sample_means' of 64 bytes, expected 108"),
    (64 + 40 + 16, "<Q", 4096, "'sample_quats' at byte 4096"),
]


@pytest.mark.parametrize(("offset", "layout", "value", "words"), LIES)
def test_a_header_that_lies_is_refused(
    path: Path, whole: bytes, offset: int, layout: str, value: int, words: str
) -> None:
    path.write_bytes(changed(whole, offset, layout, value))
    with pytest.raises(CorruptFileError, match=words) as caught:
        open_mapped(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("seed", range(150))
def test_no_header_is_believed_whatever_it_says(path: Path, whole: bytes, seed: int) -> None:
    rng, raw = np.random.default_rng(seed), bytearray(whole)
    for _ in range(rng.integers(1, 4)):
        at = int(rng.integers(8, 744 // 4)) * 4
        raw[at : at + 4] = struct.pack("<I", rng.choice([0, 1, 64, 2**31, 2**32 - 1, int(rng.integers(2**32))]))
    path.write_bytes(with_right_checksum(bytes(raw)) if struct.unpack_from("<I", raw, 44)[0] < 65 else raw)
    with suppress(LoadError):
        for name, array in open_mapped(path).arrays.items():
            assert array.nbytes == open_mapped(path).header.sections[name].nbytes
            array.tobytes()
        load(path)


def test_saving_says_what_writes_it(tmp_path: Path) -> None:
    with pytest.raises(SaveError, match="tsplat optimize writes it"):
        save(tmp_path / "x.tsplat", random_gaussians(np.random.default_rng(1), 3))


def test_sections_that_nobody_knows_are_passed_over(path: Path, whole: bytes) -> None:
    header = parse(path, whole[:4096], len(whole))
    more = dict(header.sections) | {"more": (4096 * (len(whole) // 4096 + 1), 5, 0)}
    raw = packed(Header(header.counts, True, more))  # type: ignore[arg-type]
    path.write_bytes(raw + whole[len(raw) :].ljust(4096 * (len(whole) // 4096 + 1) - len(raw)) + b"extra")
    assert len(load(path)) == COUNTS.splats


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("means", np.nan, "means must be finite"),
        ("quats", np.inf, "quats must be finite"),
        ("quats", 0.0, "quats must be of unit length"),
        ("quats", 1e30, "quats must be of unit length"),
        ("scales", -1.0, "scales must lie in"),
        ("opacities", 1.5, "opacities must lie in"),
        ("sh_first", np.nan, "sh must be finite"),
        ("sh_rest", 0x7C00, "sh must be finite"),
    ],
)
def test_values_that_no_scene_has_are_refused(path: Path, name: str, value: float, words: str) -> None:
    arrays = plausible()
    arrays[name][0][5] = value
    with path.open("wb") as file:
        write(file, COUNTS, False, arrays)
    with pytest.raises(CorruptFileError, match=words):
        load(path)


def test_a_scene_without_harmonics_has_an_empty_section(tmp_path: Path) -> None:
    cloud, path = random_gaussians(np.random.default_rng(2), 5, 0), tmp_path / "x.tsplat"
    counts = Counts(5, 1, 0, 5)
    arrays = {name: [np.zeros(length, dtype)] for name, (dtype, length) in counts.arrays.items()}
    arrays |= {"quats": [cloud.quats], "opacities": [cloud.opacities], "sh_first": [cloud.sh]}
    with path.open("wb") as file:
        write(file, counts, False, arrays)
    assert load(path).sh_degree == 0
    np.testing.assert_array_equal(load(path).sh, cloud.sh)


@pytest.mark.parametrize("fraction", [0.0, 0.3, 0.69])
def test_a_file_that_becomes_shorter_while_it_is_loaded_is_one_line(path: Path, fraction: float) -> None:
    def cut(done: float) -> None:
        if done > fraction:
            os.truncate(path, 5000)

    with pytest.raises(CorruptFileError, match="was longer when it was opened"):
        load(path, progress=cut)


def test_whether_all_of_a_map_is_still_there_is_known_before_it_is_looked_at(path: Path, whole: bytes) -> None:
    mapped = open_mapped(path)
    mapped.check_size()
    for size in (len(whole) - 1, 5000, 0):
        os.truncate(path, size)
        with pytest.raises(CorruptFileError, match="was longer when it was opened") as caught:
            mapped.check_size()
        assert caught.value.offset == size
    path.write_bytes(whole + b"more")
    mapped.check_size()


def test_another_file_in_its_place_is_noticed_and_harms_nothing(path: Path, whole: bytes) -> None:
    mapped = open_mapped(path)
    assert mapped.stamp_now() == mapped.stamp
    path.with_name("other").write_bytes(whole)
    path.with_name("other").replace(path)
    assert mapped.stamp_now() != mapped.stamp
    mapped.check_size()
    path.unlink()
    assert mapped.stamp_now() is None
    mapped.check_size()


@pytest.mark.parametrize("open_it", [open_file, open_mapped])
def test_no_file_stays_open_when_it_is_forgotten(path: Path, open_it: Callable[[Path], Opened]) -> None:
    opened = open_it(path)
    number = opened.file.fileno()
    os.fstat(number)
    del opened
    gc.collect()
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(number)
