"""SPZ files: every version against a slow twin and its PLY, and every way to be broken."""

from __future__ import annotations

import math
import struct
import warnings
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import zstandard

from tests.io.alike import angles, matrix, picture
from tests.io.outcomes import within_memory
from tests.io.spzs import SH_VALUES, Splat, bare, decoded, framed, head, streams, zipped
from tests.raster.compare import psnr
from tests.scenes import shared_scenes
from tsplat import io
from tsplat.errors import CorruptFileError, LoadError, LoadWarning, TsplatError
from tsplat.io import spz
from tsplat.io.formats import HEAD_BYTES
from tsplat.raster.reference import sh_basis
from tsplat.scene import Gaussians

VERSIONS = [1, 2, 3, 4]
GZIP_VERSIONS = VERSIONS[:3]
F32 = npt.NDArray[np.float32]


def some_splats(version: int, degree: int, count: int = 5, seed: int = 3) -> list[Splat]:
    """Return splats of random whole numbers, the ends of every range among them."""
    rng = np.random.default_rng(seed)
    ends = [(-(2**23), 2**23 - 1, -1), (0, 1, 255)]
    found = []
    for index in range(count):
        mean = tuple(int(value) for value in rng.integers(-2000, 2000, 3))
        quat = (index % 4, *(int(value) for value in rng.integers(-290, 290, 3)))
        found.append(
            Splat(
                ends[index] if index < len(ends) and version > 1 else mean,
                (0, 255, *rng.integers(0, 256, count).tolist())[index],
                tuple(rng.integers(0, 256, 3).tolist()),
                tuple(rng.integers(0, 256, 3).tolist()),
                quat if version > 2 else tuple(rng.integers(60, 190, 3).tolist()),
                rng.integers(0, 256, SH_VALUES[degree]).tolist(),
            )
        )
    return found


def whole_file(version: int, degree: int = 1) -> bytes:
    return packed_file(some_splats(version, degree), version, degree)


def packed_file(splats: list[Splat], version: int, degree: int) -> bytes:
    return framed(splats, 4, degree) if version == 4 else zipped(bare(splats, version, degree))


def load_bytes(folder: Path, raw: bytes, **options: Any) -> Gaussians:
    path = folder / "scene.spz"
    path.write_bytes(raw)
    return io.load(path, **options)


def read_rdf(path: Path) -> Gaussians:
    return io.load(path, spz_frame="rdf")


def check_splats(gaussians: Gaussians, splats: list[Splat], version: int) -> None:
    assert len(gaussians) == len(splats)
    for index, splat in enumerate(splats):
        for name, values in decoded(splat, version).items():
            found = np.ravel(getattr(gaussians, name)[index])
            np.testing.assert_allclose(found, values, 2e-6, 1e-6, err_msg=f"{name} of {index}")


@pytest.mark.parametrize("version", VERSIONS)
def test_components_that_are_too_long_make_a_unit_quat_all_the_same(tmp_path: Path, version: int) -> None:
    splats = [Splat(quat=(255, 0, 255) if version < 3 else (2, 511, -511, 511))]
    gaussians = load_bytes(tmp_path, packed_file(splats, version, 0), spz_frame="rdf")
    check_splats(gaussians, splats, version)
    assert np.linalg.norm(gaussians.quats) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("degree", range(5))
def test_every_version_means_what_the_slow_reader_says(tmp_path: Path, version: int, degree: int) -> None:
    splats = some_splats(version, degree, 40)
    path = tmp_path / "scene.spz"
    path.write_bytes(packed_file(splats, version, degree))
    gaussians = read_rdf(path)
    assert gaussians.sh_degree == degree
    check_splats(gaussians, splats, version)


@pytest.mark.parametrize("version", GZIP_VERSIONS)
def test_a_file_without_gzip_reads_the_same(tmp_path: Path, version: int) -> None:
    raw = bare(some_splats(version, 2), version, 2)
    np.testing.assert_array_equal(load_bytes(tmp_path, raw).sh, load_bytes(tmp_path, zipped(raw)).sh)
    with pytest.raises(CorruptFileError, match=r"need .* bytes, .* are there"):
        load_bytes(tmp_path, raw + b"x")


def test_the_axes_of_the_file_become_those_of_a_ply(tmp_path: Path, rng: np.random.Generator) -> None:
    turned = load_bytes(tmp_path, whole_file(3, degree=4))
    kept = read_rdf(tmp_path / "scene.spz")
    half_turn = np.diag([1.0, -1.0, -1.0])
    np.testing.assert_allclose(turned.means, kept.means @ half_turn)
    for after, before in zip(turned.quats, kept.quats, strict=True):
        np.testing.assert_allclose(matrix(after), half_turn @ matrix(before) @ half_turn, atol=1e-6)
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    basis_before, basis_after = sh_basis(np.stack([direction, half_turn @ direction]))
    seen_before = np.einsum("nkc,k->nc", kept.sh, basis_before)
    seen_after = np.einsum("nkc,k->nc", turned.sh, basis_after)
    np.testing.assert_allclose(seen_after, seen_before, atol=1e-5)


def test_the_first_bytes_decide_before_the_suffix(tmp_path: Path) -> None:
    for raw in (whole_file(3), whole_file(4), bare(some_splats(2, 0), 2, 0)):
        path = tmp_path / "scene.ply"
        path.write_bytes(raw)
        assert len(io.load(path)) == 5
    assert not spz.matches(zipped(b"ply\n"))
    assert not spz.matches(b"\x1f\x8b with no gzip behind it")


@pytest.mark.parametrize("level", range(1, 10))
def test_the_first_bytes_are_always_enough_to_tell_an_spz_from_other_gzip(level: int) -> None:
    rng = np.random.default_rng(level)
    noise = rng.integers(0, 256, 1 << 16).astype(np.uint8).tobytes()
    skewed = np.minimum(rng.geometric(0.03, 1 << 16), 255).astype(np.uint8).tobytes()  # long tables of codes
    for rest in (noise, skewed, bytes(1 << 16)):
        packed = zlib.compressobj(level, wbits=31)
        raw = packed.compress(b"NGSP" + rest) + packed.flush()
        assert spz.matches(raw[:HEAD_BYTES])
        packed = zlib.compressobj(level, wbits=31)
        raw = packed.compress(b"NGSQ" + rest) + packed.flush()
        assert not spz.matches(raw[:HEAD_BYTES])


def test_a_limit_keeps_the_weightiest_and_progress_grows_to_one(tmp_path: Path) -> None:
    seen: list[float] = []
    splats = [Splat((index, 0, 0), scale=(index, index, index), quat=(3, 0, 0, 0)) for index in range(9)]
    gaussians = load_bytes(tmp_path, zipped(bare(splats, 3, 0, 0)), max_splats=2, progress=seen.append)
    assert gaussians.means[:, 0].tolist() == [7.0, 8.0]
    assert seen == sorted(seen)
    assert len(seen) > 5
    assert (0.0 < seen[0] < 0.5, seen[-1]) == (True, 1.0)


@pytest.mark.parametrize("version", VERSIONS)
def test_a_file_of_no_splats_is_an_empty_scene(tmp_path: Path, version: int) -> None:
    assert load_bytes(tmp_path, packed_file([], version, 3)).sh.shape == (0, 16, 3)


def test_halves_that_are_no_numbers_are_left_out(tmp_path: Path) -> None:
    means = [(math.inf, -math.inf, 0), (math.nan, 0, 0), (1.5, -2.0, 65504.0), (0, math.inf, 0)]
    with pytest.warns(LoadWarning, match="dropped 3 of 4 splats"):
        gaussians = load_bytes(tmp_path, zipped(bare([Splat(mean) for mean in means], 1, 0)))
    assert gaussians.means.tolist() == [[1.5, 2.0, -65504.0]]


def test_what_unknown_flags_announce_is_passed_over_with_a_warning(tmp_path: Path) -> None:
    raw = bare(some_splats(3, 1), 3, 1, flags=0x81)
    new = framed(some_splats(4, 1), 4, 1, flags=0x81, between=bytes(12))
    for file in (zipped(raw + bytes(100_000)), raw + bytes(99), new):
        with pytest.warns(LoadWarning, match="flags 0x80 are not known here") as caught:
            assert len(load_bytes(tmp_path, file)) == 5
        assert caught[0].filename == __file__, "the warning points at the caller of load"


@pytest.mark.parametrize("version", VERSIONS)
def test_a_file_cut_anywhere_is_refused(tmp_path: Path, version: int) -> None:
    files = [whole_file(version)]
    if version < 4:
        files.append(bare(some_splats(version, 1), version, 1))
    for whole in files:
        assert len(load_bytes(tmp_path, whole)) == 5
        for length in range(len(whole)):
            with pytest.raises(LoadError, match=r"scene\.spz") as caught:
                load_bytes(tmp_path, whole[:length])
            assert isinstance(caught.value, CorruptFileError) or length == 0
            assert "\n" not in str(caught.value)
        assert len(load_bytes(tmp_path, whole)) == 5


@pytest.mark.parametrize("version", GZIP_VERSIONS)
def test_packed_bytes_that_end_early_are_refused(tmp_path: Path, version: int) -> None:
    raw = bare(some_splats(version, 1), version, 1)
    for length in range(len(b"NGSP"), len(raw)):  # a shorter one is no SPZ
        with pytest.raises(CorruptFileError, match=r"ends .*; fetch it again"):
            load_bytes(tmp_path, zipped(raw[:length]))


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("version", VERSIONS)
def test_a_changed_byte_is_an_error_or_another_scene(tmp_path: Path, version: int, packed: bool) -> None:
    rng = np.random.default_rng(version)
    whole = whole_file(version) if packed or version == 4 else bare(some_splats(version, 1), version, 1)
    outcomes = set()
    for _ in range(300):
        raw = bytearray(whole)
        for place in rng.integers(0, len(raw), rng.integers(1, 4)):
            raw[place] = rng.integers(0, 256)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", LoadWarning)
            try:
                load_bytes(tmp_path, bytes(raw))
                outcomes.add("loaded")
            except TsplatError as error:
                outcomes.add("refused in one line" if "\n" not in str(error) else str(error))
    assert outcomes == {"loaded", "refused in one line"}


LIARS = {
    "huge count": (zipped(head(2**32 - 1, 3, 3) + bytes(1000)), "4294967295 splats need .* more than"),
    "huge bare count": (head(2**32 - 1, 2, 4) + bytes(1000), "4294967295 splats need .* bytes, 1016 are there"),
    "one splat too few": (
        zipped(bare(some_splats(3, 1), 3, 1)[:8] + struct.pack("<I", 4) + bytes(500)),
        "holds more",
    ),
    "SH degree": (zipped(head(0, 3, 5)), "at byte 12: has SH degree 5, expected 0 to 4"),
    "fractional bits": (zipped(head(0, 3, 0, bits=25)), "at byte 13: has 25 fractional bits, expected 0 to 24"),
    "not the magic": (zipped(b"NGSX" + head(0, 3, 0)[4:]), "at byte 0: begins with b'NGSX', expected b'NGSP'"),
    "no magic at all": (b"hello" + bytes(15), "at byte 0: begins with b'hell', expected b'NGSP' or gzip"),
    "no deflate": (b"\x1f\x8b\x08" + bytes(7) + b"\xff" * 99, "does not unpack"),
    "wrong checksum": (whole_file(3)[:-8] + bytes(8), "does not unpack"),
}


@pytest.mark.parametrize("name", LIARS)
def test_a_file_that_lies_is_one_clear_line(tmp_path: Path, name: str) -> None:
    raw, message = LIARS[name]
    with pytest.raises(CorruptFileError, match=message + ".*; fetch it again") as caught:
        load_bytes(tmp_path, raw)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("version", [0, 5, 2**31])
def test_an_unknown_version_says_which_are_known(tmp_path: Path, version: int) -> None:
    for raw in (head(0, version, 0), zipped(head(0, version, 0))):
        with pytest.raises(LoadError, match=f"at byte 4: is SPZ of version {version}, expected 1 to "):
            load_bytes(tmp_path, raw)


def test_a_bomb_behind_the_last_stream_is_not_unpacked(tmp_path: Path) -> None:
    raw = bare(some_splats(3, 0), 3, 0, flags=2) + bytes(50_000_000)
    with pytest.raises(CorruptFileError, match="holds more than its header says"):
        load_bytes(tmp_path, zipped(raw))
    assert within_memory(tmp_path / "scene.spz", 0) is None


def changed(place: int, layout: str, value: int) -> bytes:
    """Return a file of version 4 with another number at a place."""
    raw = bytearray(whole_file(4))
    struct.pack_into(layout, raw, place, value)
    return bytes(raw)


def reframed(first: bytes, unpacked: int = 45) -> bytes:
    """Return a file of version 4 of five splats whose first frame is another."""
    raw = whole_file(4)
    start = 32 + 6 * 16
    size = struct.unpack_from("<Q", raw, 32)[0]
    return raw[:32] + struct.pack("<QQ", len(first), unpacked) + raw[48:start] + first + raw[start + size :]


PLAIN = zstandard.ZstdCompressor()
NO_SIZE = zstandard.ZstdCompressor(write_content_size=False)
NEW_LIARS = {
    "huge count": (changed(8, "<I", 2**32 - 1), "4294967295 splats need .* more than"),
    "one splat too many": (changed(8, "<I", 6), "says 45 bytes of means, expected 54"),
    "no streams": (changed(15, "<B", 0), "at byte 15: has 0 streams, expected 6"),
    "many streams": (changed(15, "<B", 255), "has 255 streams, expected 6"),
    "table in the header": (changed(16, "<I", 16), "at byte 16: has its table at byte 16, expected 32 to"),
    "table far away": (changed(16, "<I", 2**32 - 1), "has its table at byte 4294967295"),
    "endless frame": (changed(32, "<Q", 2**64 - 1), "18446744073709551615 packed bytes of means begin at"),
    "bytes behind the end": (whole_file(4) + b"x", "has 1 bytes behind the last stream"),
    "frame of another size": (reframed(PLAIN.compress(bytes(44))), "means unpack to 44 bytes, expected 45"),
    "frame of no size, short": (reframed(NO_SIZE.compress(bytes(44))), "means unpack to 44 bytes"),
    "frame of no size, long": (reframed(NO_SIZE.compress(bytes(10**7))), "means do not unpack"),
    "frame that promises much": (reframed(PLAIN.compress(bytes(10**7))), "means unpack to 10000000 bytes"),
    "frame that promises all": (
        reframed(b"\x28\xb5\x2f\xfd\xe0" + struct.pack("<Q", 2**50) + b"\x01\x00\x00"),
        "means unpack to 1125899906842624 bytes, expected 45",
    ),
    "frame with a window of gigabytes": (
        reframed(b"\x28\xb5\x2f\xfd\x00\xaf\x01\x00\x00"),
        "means do not unpack: .* too much memory",
    ),
    "two frames": (reframed(PLAIN.compress(bytes(45)) * 2), "means do not unpack"),
    "frame that is none": (reframed(b"no frame at all"), "means do not unpack"),
    "empty frame": (reframed(b""), "means do not unpack"),
}


@pytest.mark.parametrize("name", NEW_LIARS)
def test_a_file_of_version_4_that_lies_is_one_clear_line(tmp_path: Path, name: str) -> None:
    raw, message = NEW_LIARS[name]
    with pytest.raises(CorruptFileError, match=message + ".*; fetch it again") as caught:
        load_bytes(tmp_path, raw)
    assert "\n" not in str(caught.value)


def test_a_frame_that_keeps_its_size_to_itself_is_read(tmp_path: Path) -> None:
    means = streams(some_splats(4, 1), 4)[0]
    found = load_bytes(tmp_path, reframed(NO_SIZE.compress(means)))
    np.testing.assert_array_equal(found.means, load_bytes(tmp_path, whole_file(4)).means)


def test_version_4_in_gzip_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LoadError, match="is SPZ of version 4, expected 1 to 3"):
        load_bytes(tmp_path, zipped(whole_file(4)))


SCENES = shared_scenes()
needs_scenes = pytest.mark.skipif(
    SCENES is None, reason="no folder of real scenes: set TSPLAT_SCENES or have ../shared/scenes"
)


@needs_scenes
@pytest.mark.parametrize(
    ("name", "twin", "degrees", "decibels"),
    [
        ("yashica_v2_gaussforge.spz", "yashica.ply", 12.0, 29.0),
        ("yashica_v3.spz", "yashica.ply", 0.25, 33.0),
        ("yashica_v4.spz", "yashica.ply", 0.25, 33.0),
        ("playbot31k_v4.spz", "playbot31k.ply", 0.25, 43.0),
        ("playbot31k_v2_gaussforge.spz", "playbot31k.ply", 12.0, 43.0),
    ],
)
def test_a_real_scene_agrees_with_its_ply(name: str, twin: str, degrees: float, decibels: float) -> None:
    assert SCENES is not None
    path = SCENES / "format_matrix" / name
    truth = io.load(SCENES / "format_matrix" / twin)
    found = read_rdf(path) if "gaussforge" in name else io.load(path)
    assert found.sh.shape == truth.sh.shape
    np.testing.assert_allclose(found.means, truth.means, atol=0.6 / 2**12)
    assert angles(found.quats, truth.quats).max() < degrees
    logs = np.clip(np.log(truth.scales), -10, 255 / 16 - 10)
    np.testing.assert_allclose(np.log(found.scales), logs, atol=0.5 / 16 + 1e-4)
    np.testing.assert_allclose(found.opacities, truth.opacities, atol=0.51 / 255)
    colours = np.clip(truth.sh[:, 0], -0.5 / 0.15, 0.5 / 0.15)
    np.testing.assert_allclose(found.sh[:, 0], colours, atol=0.51 / 255 / 0.15)
    rest = np.clip(truth.sh[:, 1:], -1, 1)
    np.testing.assert_allclose(found.sh[:, 1:], rest, atol=8.6 / 128)
    image = psnr(picture(found, truth), picture(truth, truth))
    assert image >= decibels, f"{image:.1f} dB"


FIXTURES = SCENES and SCENES / "splat-transform-fixtures/test/fixtures/splat"


@needs_scenes
@pytest.mark.parametrize(
    ("name", "twin"), [("minimal-v2.spz", "minimal-raw.spz"), ("minimal-v4.spz", "minimal-v3.spz")]
)
def test_a_small_file_of_another_writer_is_like_its_twin(name: str, twin: str) -> None:
    assert FIXTURES is not None
    found, truth = io.load(FIXTURES / name), io.load(FIXTURES / twin)
    assert len(found) == 4
    for part in ("means", "quats", "scales", "opacities", "sh"):
        np.testing.assert_array_equal(getattr(found, part), getattr(truth, part), err_msg=part)
    np.testing.assert_allclose(np.abs(found.means).max(axis=0), [1, 0, 1])
    np.testing.assert_allclose(found.opacities, 230 / 255, rtol=1e-6)
