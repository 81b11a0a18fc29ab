"""What an SPZ says beside its splats: the axes that it is in, and records that change nothing or are unknown."""

from __future__ import annotations

import struct
import warnings
from pathlib import Path

import numpy as np
import pytest

from tests.io.spzs import bare, framed, zipped
from tests.io.test_spz import some_splats
from tsplat import io
from tsplat.errors import LoadWarning, OptionError
from tsplat.io.options import SPZ_FRAMES, LoadOptions
from tsplat.io.spz import find_frame
from tsplat.io.spz_frames import axes_of
from tsplat.raster.reference import sh_basis
from tsplat.rotations import rotations_of
from tsplat.scene import Gaussians

AXES, ORBIT, ROUNDING = 0xADBE0003, 0xADBE0002, 0xADBE0001
RDF = SPZ_FRAMES.index("rdf") + 1


def record(kind: int, content: bytes) -> bytes:
    return struct.pack("<II", kind, len(content)) + content


def saying(frame: int) -> bytes:
    return record(AXES, struct.pack("<I", frame))


def files(records: bytes) -> list[bytes]:
    """Return the same scene with these records in every container that has room for some."""
    raw = bare(some_splats(3, 3), 3, 3, flags=2) + records
    return [raw, zipped(raw), framed(some_splats(4, 3), 4, 3, flags=2, between=records)]


def written(folder: Path, raw: bytes) -> Path:
    path = folder / "scene.spz"
    path.write_bytes(raw)
    return path


def check_same(found: Gaussians, expected: Gaussians) -> None:
    for name in ("means", "quats", "scales", "opacities", "sh"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)


def seen(gaussians: Gaussians, toward: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return centres, covariances and the colours that are seen along directions, all in float64."""
    axes = rotations_of(gaussians.quats) * gaussians.scales[:, None, :].astype(np.float64)
    colors = np.einsum(
        "dk,nkc->ndc", sh_basis(toward)[:, : gaussians.sh.shape[1]], gaussians.sh.astype(np.float64)
    )
    return gaussians.means, axes @ axes.transpose(0, 2, 1), colors


@pytest.mark.parametrize("frame", SPZ_FRAMES)
def test_splats_in_any_axes_are_where_those_axes_point(
    tmp_path: Path, frame: str, rng: np.random.Generator
) -> None:
    path = written(tmp_path, files(saying(SPZ_FRAMES.index(frame) + 1))[1])
    stored, found = io.load(path, spz_frame="rdf"), io.load(path)
    matrix = axes_of(frame)
    toward = rng.normal(size=(20, 3))
    toward /= np.linalg.norm(toward, axis=1)[:, None]
    means, covariances, colors = seen(stored, toward)
    found_means, found_covariances, found_colors = seen(found, toward @ matrix.T)
    np.testing.assert_allclose(found_means, means @ matrix.T, rtol=1e-6)
    expected = matrix @ covariances @ matrix.T
    np.testing.assert_allclose(found_covariances, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())
    np.testing.assert_allclose(found_colors, colors, atol=1e-5)
    check_same(found, io.load(path, spz_frame=frame))


def test_letters_of_axes_are_their_directions_in_those_of_a_ply() -> None:
    assert axes_of("rdf").tolist() == np.eye(3).tolist()
    assert axes_of("rub").tolist() == np.diag([1.0, -1.0, -1.0]).tolist()
    assert axes_of("lfu").tolist() == [[-1, 0, 0], [0, 0, -1], [0, 1, 0]]  # its y is front, its z is up


@pytest.mark.parametrize("container", range(3))
def test_a_record_of_axes_is_obeyed_unless_others_are_asked_for(tmp_path: Path, container: int) -> None:
    silent = io.load(written(tmp_path, files(b"")[container]), spz_frame="rdf")
    path = written(tmp_path, files(saying(RDF))[container])
    check_same(io.load(path), silent)
    assert find_frame(path, LoadOptions()) == ("rdf", "record")
    assert np.any(io.load(path, spz_frame="rub").means != silent.means)
    assert find_frame(path, LoadOptions(spz_frame="luf")) == ("luf", "option")
    assert find_frame(written(tmp_path, files(saying(0))[container]), LoadOptions()) == ("rub", "format")


@pytest.mark.parametrize(
    "records",
    [
        record(ORBIT, bytes(12)),
        record(ROUNDING, b"\4\5"),
        struct.pack("<I", ORBIT) + struct.pack("<3f", -0.5, 0.5, 1.0),  # as written before records had lengths
        struct.pack("<I", ROUNDING) + b"\4\5",
        bytes(64),
    ],
)
@pytest.mark.parametrize("container", range(3))
def test_records_that_change_no_splat_are_passed_over_in_silence(
    tmp_path: Path, records: bytes, container: int
) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        plain = io.load(written(tmp_path, files(b"")[container]))
        check_same(io.load(written(tmp_path, files(records)[container])), plain)
        path = written(tmp_path, files(records[: len(records) // 4 * 4] + saying(RDF))[container])
        if len(records) % 4 == 0:
            assert find_frame(path, LoadOptions()).name == "rdf", "the record behind them is found"


@pytest.mark.parametrize(
    ("records", "problem"),
    [
        (record(0x12340001, bytes(24)), "records of type 0x12340001 (24 bytes) are not known here"),
        (
            b"".join(record(0x1000 + each, b"") for each in range(9)),
            "0x00001002 (0 bytes) and 6 more are not known",
        ),
        (saying(17), "its record of axes says 17, expected 1 to 16"),
        (struct.pack("<II", 0x12340001, 1 << 31), "goes on behind the 8 bytes of all records"),
    ],
)
@pytest.mark.parametrize("container", range(3))
def test_a_record_that_may_matter_is_named(tmp_path: Path, records: bytes, problem: str, container: int) -> None:
    with pytest.warns(LoadWarning) as caught:
        assert len(io.load(written(tmp_path, files(records)[container]))) == 5
    assert problem in str(caught[0].message)
    assert len(caught) == 1


def test_axes_of_other_names_are_refused(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match=r"spz_frame must be one of .*rub.*, got 'up'"):
        io.load(written(tmp_path, files(b"")[0]), spz_frame="up")
