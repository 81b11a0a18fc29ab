"""What is sent after the first frame: changed cells, forgotten cells, and less when fewer bytes are wanted."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pyte
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.encode.frames import U8, gradient
from tests.encode.screens import pixels, show
from tsplat.encode.cells import TOLERANCE, Cells

F64 = npt.NDArray[np.float64]

SHAPES = ["octant", "sextant", "quadrant", "half", "braille"]
COLORS = [1 << 24, 256, 16, 0]
COLUMNS, ROWS = 12, 5


def a_frame(cells: Cells, seed: int = 1, columns: int = COLUMNS, rows: int = ROWS) -> U8:
    across, down = cells.pixels_per_cell(0, 0)
    return np.random.default_rng(seed).integers(0, 256, (rows * down, columns * across, 3), dtype=np.uint8)


def shown(screen: pyte.Screen, cells: Cells, columns: int = COLUMNS, rows: int = ROWS) -> U8:
    return pixels(screen, columns, rows, *cells.pixels_per_cell(0, 0), default=(255, 255, 255))


def sent(cells: Cells, frame: U8, columns: int = COLUMNS, rows: int = ROWS) -> bytes:
    return cells.encode(frame, columns, rows, (0, 0)).draw


def changed(frame: U8, cells: Cells, seed: int, share: float) -> U8:
    """Return a frame in which a share of the cells, here and there, hold something else."""
    across, down = cells.pixels_per_cell(0, 0)
    rows, columns = len(frame) // down, frame.shape[1] // across
    chosen = np.random.default_rng(seed).random((rows, columns)) < share
    where = chosen.repeat(down, axis=0).repeat(across, axis=1)[..., None]
    return np.where(where, a_frame(cells, seed, columns, rows), frame)


@pytest.mark.parametrize("colors", COLORS)
@pytest.mark.parametrize("name", [*SHAPES, "ascii", "half256"])
def test_an_equal_frame_sends_nothing(name: str, colors: int) -> None:
    cells = Cells(name, colors)
    frame = a_frame(cells)
    assert sent(cells, frame)
    assert sent(cells, frame.copy()) == b""


@settings(max_examples=60)
@given(
    st.sampled_from(SHAPES),
    st.sampled_from(COLORS),
    st.lists(st.tuples(st.integers(2, 99), st.sampled_from([0.02, 0.2, 0.6, 1.0])), min_size=1, max_size=4),
)
def test_after_any_changes_the_screen_is_as_if_drawn_anew(
    name: str, colors: int, changes: list[tuple[int, float]]
) -> None:
    cells, frame = Cells(name, colors), a_frame(Cells(name))
    screen = pyte.Screen(COLUMNS + 2, ROWS + 2)
    stream = pyte.ByteStream(screen)
    stream.feed(sent(cells, frame))
    for seed, share in changes:
        frame = changed(frame, cells, seed, share)
        stream.feed(b"\x1b[H\x1b[1;44m" + sent(cells, frame))
    fresh = show(sent(Cells(name, colors), frame), COLUMNS + 2, ROWS + 2)
    assert np.array_equal(shown(screen, cells), shown(fresh, cells))
    assert screen.display[ROWS:] == [" " * (COLUMNS + 2)] * 2
    assert not any(cell.bold for row in range(ROWS) for cell in screen.buffer[row].values())


@settings(max_examples=30)
@given(st.sampled_from(COLORS), st.integers(0, 999))
def test_after_any_changes_ascii_is_as_if_drawn_anew(colors: int, seed: int) -> None:
    cells = Cells("ascii", colors)
    frame = a_frame(cells, seed)
    screen = show(sent(cells, frame), COLUMNS, ROWS)
    frame = changed(frame, cells, seed + 1, 0.4)
    pyte.ByteStream(screen).feed(b"\x1b[H" + sent(cells, frame))
    fresh = show(sent(Cells("ascii", colors), frame), COLUMNS, ROWS)
    assert screen.display == fresh.display
    for row in range(ROWS):
        for column in range(COLUMNS):
            cell, same = screen.buffer[row][column], fresh.buffer[row][column]
            assert cell.bg == same.bg
            assert cell.data == " " or cell.fg == same.fg


def test_a_single_change_takes_a_move_and_one_cell() -> None:
    cells = Cells("octant")
    frame = np.tile(gradient(40, 24), (10, 10, 1))
    sent(cells, frame, 200, 60)
    frame[4 * 41 : 4 * 42, 2 * 77 : 2 * 78] = 255
    stream = sent(cells, frame, 200, 60)
    assert stream == b"\x1b[0m\x1b7\x1b8\x1b[41B\x1b7\x1b[77C\x1b[48;2;255;255;255m \x1b8\x1b[0m"


def test_cells_between_two_changes_are_written_again_only_where_that_is_shorter() -> None:
    cells = Cells("ascii", 0)
    frame = np.zeros((2, 20, 3), np.uint8)
    sent(cells, frame, 20, 1)
    frame[:, [1, 3, 6, 10, 15]] = 255
    assert sent(cells, frame, 20, 1) == b"\x1b[0m\x1b7 @ @  @   @\x1b[4C@\x1b8\x1b[0m"
    coloured = Cells("quadrant")
    frame = np.zeros((2, 20, 3), np.uint8)
    frame[:, 8:10] = 90
    sent(coloured, frame, 10, 1)
    frame[:, [0, 1, 4, 5]] = 255
    frame[:, 8:10] = 91
    grey, white = b"\x1b[48;2;91;91;91m", b"\x1b[48;2;255;255;255m"
    assert sent(coloured, frame, 10, 1) == b"\x1b[0m\x1b7" + white + b" \x1b[C \x1b[C" + grey + b" \x1b8\x1b[0m"


@pytest.mark.parametrize("name", SHAPES)
def test_text_over_the_picture_stays_until_its_cells_are_forgotten(name: str) -> None:
    cells = Cells(name)
    frame = a_frame(cells)
    screen = show(sent(cells, frame), COLUMNS, ROWS)
    stream = pyte.ByteStream(screen)
    stream.feed(b"\x1b[3;4H\x1b[0mHUD\x1b[H")
    stream.feed(sent(cells, frame))
    assert screen.display[2][3:6] == "HUD"
    covered = np.zeros((ROWS, COLUMNS), bool)
    covered[2, 3:6] = True
    cells.forget(covered)
    again = sent(cells, frame)
    stream.feed(b"\x1b[H" + again)
    fresh = show(sent(Cells(name), frame), COLUMNS, ROWS)
    assert np.array_equal(shown(screen, cells), shown(fresh, cells))
    assert len(again) < 200
    assert sent(cells, frame) == b""


@pytest.mark.parametrize("how", ["forget all", "forget another size", "clear", "resize"])
def test_everything_is_sent_again_when_nothing_is_known_of_the_screen(how: str) -> None:
    cells = Cells("half")
    frame = a_frame(cells)
    first = sent(cells, frame)
    match how:
        case "forget all":
            cells.forget(None)
        case "forget another size":
            cells.forget(np.zeros((3, 3), bool))
        case "clear":
            assert cells.clear() == b""
        case _:
            sent(cells, frame, COLUMNS - 1, ROWS)
    assert sent(cells, frame) == first


@pytest.mark.parametrize("colors", COLORS)
@pytest.mark.parametrize("name", [*SHAPES, "ascii"])
def test_the_lower_the_fidelity_the_fewer_bytes_a_moving_picture_takes(name: str, colors: int) -> None:
    across, down = Cells(name).pixels_per_cell(0, 0)
    wide = gradient(40 * across + 16, 20 * down) // 2 + 40
    wide = wide + np.random.default_rng(1).integers(0, 40, wide.shape, dtype=np.uint8)
    sizes = []
    for fidelity in (1.0, 0.7, 0.4, 0.0):
        cells = Cells(name, colors)
        assert cells.fidelity == 1.0
        cells.fidelity = fidelity
        frames = [np.ascontiguousarray(wide[:, x : x + 40 * across]) for x in range(8)]
        sizes.append(sum(len(sent(cells, frame, 40, 20)) for frame in frames))
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[-1] < 0.7 * sizes[0]


@pytest.mark.parametrize("name", ["octant", "quadrant", "half"])
@pytest.mark.parametrize("fidelity", [0.9, 0.6, 0.2])
def test_what_is_left_out_is_never_more_than_the_tolerance(name: str, fidelity: float) -> None:
    cells, exact = Cells(name), Cells(name)
    cells.fidelity = fidelity
    screen = pyte.Screen(COLUMNS, ROWS)
    stream = pyte.ByteStream(screen)
    tolerance = TOLERANCE * (1 - fidelity)
    wide = gradient(80, 30).astype(np.int64) + np.random.default_rng(3).integers(-20, 20, (30, 80, 3))
    across, down = cells.pixels_per_cell(0, 0)
    for x in range(10):
        frame = np.clip(wide[: ROWS * down, x : x + COLUMNS * across], 0, 255).astype(np.uint8)
        stream.feed(b"\x1b[H" + sent(cells, frame))
        exact.forget(None)
        best = shown(show(sent(exact, frame), COLUMNS, ROWS), exact)

        def error(picture: U8, frame: U8 = frame) -> F64:
            squares = ((picture.astype(float) - frame) ** 2).sum(axis=2)
            of_cells: F64 = squares.reshape(ROWS, down, COLUMNS, across).mean(axis=(1, 3))
            return of_cells

        # A cell kept is at most this much worse; one sent has colours at most that far from the best ones.
        worse = np.sqrt(error(shown(screen, cells))) - np.sqrt(error(best))
        assert worse.max() <= tolerance + 0.5


@pytest.mark.parametrize("colors", COLORS)
@pytest.mark.parametrize("name", SHAPES)
def test_black_that_turns_white_is_followed_at_any_fidelity(name: str, colors: int) -> None:
    cells = Cells(name, colors)
    cells.fidelity = 0.0
    white = np.full_like(a_frame(cells), 255)
    screen = show(sent(cells, 0 * white), COLUMNS, ROWS)
    pyte.ByteStream(screen).feed(b"\x1b[H" + sent(cells, white))
    assert shown(screen, cells).min() >= 229


@pytest.mark.parametrize("colors", COLORS)
@pytest.mark.parametrize("name", SHAPES)
def test_the_picture_becomes_exact_once_the_fidelity_is_1_again(name: str, colors: int) -> None:
    cells = Cells(name, colors)
    screen = pyte.Screen(COLUMNS, ROWS)
    stream = pyte.ByteStream(screen)
    frames = [gradient(*reversed(a_frame(cells).shape[:2])) // 2 + np.uint8(step) for step in range(0, 60, 10)]
    for cells.fidelity, frame in zip((0.3, 0.1, 0.5, 0.3, 0.2), frames, strict=False):
        stream.feed(b"\x1b[H" + sent(cells, frame))
    fresh = shown(show(sent(Cells(name, colors), frames[-1]), COLUMNS, ROWS), cells)
    assert not np.array_equal(shown(screen, cells), fresh)
    cells.fidelity = 1.0
    stream.feed(b"\x1b[H" + sent(cells, frames[-1]))
    assert np.array_equal(shown(screen, cells), fresh)
