"""What all readers share: chunks on threads, arrays in memory once, and the last step against a slow twin."""

from __future__ import annotations

import time
import tracemalloc
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.io.ksplats import Part, ksplat
from tests.io.sogs import made_up
from tests.scenes import random_gaussians
from tsplat import io
from tsplat.errors import LoadWarning
from tsplat.importance import importance
from tsplat.io.arrays import Arrays, chunks
from tsplat.io.finish import finish
from tsplat.io.threads import on_threads
from tsplat.scene import Gaussians

COUNT = 30_000
SLACK = 3 << 20
"""Bytes that a few chunks, images and tables may take, whatever the scene."""


@pytest.fixture(params=[1, 3], autouse=True)
def _processors(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let readers believe in this many processors."""
    monkeypatch.setattr("tsplat.io.threads.available_processors", lambda: request.param)


def slowly_finished(arrays: Arrays, max_splats: int | None) -> list[list[np.ndarray]]:
    """Return what is left of each splat, one after the other."""
    rows = []
    for splat in zip(*arrays, strict=True):
        length = np.linalg.norm(splat[1].astype(np.float64))
        if length > 0 and all(np.isfinite(part).all() for part in splat):
            rows.append([np.array(part) for part in (splat[0], splat[1] / length, *splat[2:])])
    if max_splats is not None and len(rows) > max_splats:
        weights = [importance(row[2][None], row[3][None])[0] for row in rows]
        best = sorted(sorted(range(len(rows)), key=lambda index: -weights[index])[:max_splats])
        rows = [rows[index] for index in best]
    return rows


def broken(rng: np.random.Generator, count: int) -> Arrays:
    """Return splats of which some cannot be drawn, with quats of many lengths."""
    arrays = Arrays(*(np.array(array) for array in random_gaussians(rng, count, 1).arrays))
    arrays.quats[:] *= rng.uniform(1e-30, 1e30, (count, 1)).astype(np.float32)
    for array, value in zip(arrays, (np.nan, 0.0, np.inf, np.nan, -np.inf), strict=True):
        array[rng.integers(0, count, count // 20)] = value
    arrays.sh[3:5] = np.finfo(np.float32).max  # finite, though their sum is not
    return arrays


@pytest.mark.parametrize("max_splats", [None, 7, 1000])
@pytest.mark.parametrize("rows", [1, 16, 5000])
def test_what_is_left_is_what_the_slow_twin_leaves(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch, rows: int, max_splats: int | None
) -> None:
    monkeypatch.setattr("tsplat.io.arrays.CHUNK", rows)
    arrays = broken(rng, 100)
    expected = slowly_finished(arrays, max_splats)
    with pytest.warns(LoadWarning, match=f"dropped {100 - len(slowly_finished(arrays, None))} of 100 splats"):
        found = finish(Path("scene.x"), *arrays, max_splats=max_splats)
    assert len(found) == len(expected)
    for index, row in enumerate(expected):
        for array, value in zip(found.arrays, row, strict=True):
            np.testing.assert_allclose(array[index], value, rtol=1e-6)


def test_the_scene_lies_in_the_arrays_of_the_reader(rng: np.random.Generator) -> None:
    arrays = Arrays(*(np.array(array) for array in random_gaussians(rng, 50, 2).arrays))
    found = finish(Path("scene.x"), *arrays, max_splats=None)
    for given, kept in zip(arrays, found.arrays, strict=True):
        assert np.shares_memory(given, kept)


def test_arrays_that_are_views_or_read_only_are_cut_as_well(rng: np.random.Generator) -> None:
    whole = random_gaussians(rng, 50, 1)
    both = np.concatenate([whole.means, whole.scales], axis=1)
    means, scales = both[:, :3], both[:, 3:]
    few = finish(Path("scene.x"), means, whole.quats, scales, whole.opacities, whole.sh, max_splats=20)
    assert len(few) == 20
    assert len(whole) == 50
    np.testing.assert_array_equal(whole.means, both[:, :3])


def test_pieces_of_one_array_are_cut_and_let_go_of_the_rest(rng: np.random.Generator) -> None:
    whole = random_gaussians(rng, 50, 0)
    flat = np.concatenate([array.ravel() for array in whole.arrays])
    pieces = np.split(flat, np.cumsum([array.size for array in whole.arrays])[:-1])
    given = [piece.reshape(array.shape) for piece, array in zip(pieces, whole.arrays, strict=True)]
    found = finish(Path("scene.x"), *given, max_splats=20)
    assert len(found) == 20
    assert not any(np.shares_memory(array, flat) for array in found.arrays)


def test_chunks_cover_every_row_once() -> None:
    for count in range(10):
        assert [row for rows in chunks(count, 4) for row in range(count)[rows]] == list(range(count))


def test_every_item_is_worked_on_once_and_drawn_by_one_thread_at_a_time() -> None:
    def items() -> Iterator[int]:
        for number in range(200):
            time.sleep(0.0002)  # a generator that is entered again while it sleeps raises
            yield number

    seen: list[int] = []
    on_threads(seen.append, items())
    assert sorted(seen) == list(range(200))


def test_numpy_keeps_silent_on_every_thread() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        on_threads(lambda number: np.float32([number]) / np.float32([0.0]), range(100))


@pytest.mark.parametrize("where", ["items", "work"])
def test_an_error_ends_the_work_and_comes_through(where: str) -> None:
    done: list[int] = []

    def items() -> Iterator[int]:
        yield from range(10)
        if where == "items":
            raise ValueError("no more to read")
        yield from range(10, 5000)

    def work(number: int) -> None:
        if where == "work" and number == 10:
            raise ValueError("not to be decoded")
        if number > 10:
            time.sleep(0.001)  # time enough for the error to stop all others
        done.append(number)

    with pytest.raises(ValueError, match=r"no more to read|not to be decoded"):
        on_threads(work, items())
    assert len(done) < 2500


SAVED = ("ply", "compressed.ply", "splat", "spz")


def made(folder: Path, suffix: str) -> Path:
    """Return a file of many splats with as many harmonics as the format has."""
    rng = np.random.default_rng(3)
    path = folder / f"scene.{suffix}"
    if suffix == "sog":
        path.write_bytes(made_up(rng, COUNT, 3, (200, 150)).zipped())
    elif suffix == "ksplat":
        path.write_bytes(ksplat(0, [Part(random_gaussians(rng, COUNT, 2))]))
    else:
        io.save(path, random_gaussians(rng, 4 * COUNT if suffix == "splat" else COUNT, 3))
    return path


def peak(read: Callable[[], Gaussians]) -> tuple[Gaussians, int]:
    """Return a scene, and the most bytes that Python and NumPy held while it was read."""
    tracemalloc.start()
    try:
        scene = read()
        return scene, tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("limit", [None, 25_000])
@pytest.mark.parametrize("suffix", [*SAVED, "sog", "ksplat"])
@pytest.mark.filterwarnings("ignore::tsplat.errors.SaveWarning")  # a .splat has no harmonics
def test_a_reader_holds_a_scene_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str, limit: int | None
) -> None:
    monkeypatch.setattr("tsplat.io.arrays.CHUNK", 512)
    monkeypatch.setattr("tsplat.io.ply_rows.CHUNK_BYTES", 1 << 16)
    monkeypatch.setattr("tsplat.io.compressed_ply.BLOCK", 512)
    monkeypatch.setattr("tsplat.io.spz.ROWS", 512)
    path = made(tmp_path, suffix)
    whole = io.load(path)  # imports what it needs
    _, most = peak(lambda: io.load(path, max_splats=limit))
    # All planes of a SOG are unpacked side by side before the scene, which is counted here from the beginning.
    assert most < (1.2 if suffix == "sog" else 1.1) * whole.nbytes + SLACK
