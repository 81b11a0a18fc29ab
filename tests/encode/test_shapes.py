"""Cells of every shape and number of colours, as a terminal shows them."""

from __future__ import annotations

import re

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.encode.frames import U8, gradient
from tests.encode.screens import XTERM_COLORS, lit, pixels, show
from tsplat.encode.cells import Cells
from tsplat.encode.glyphs import FULL_BLOCK, RAMP
from tsplat.errors import OptionError

F64 = npt.NDArray[np.float64]

BLOCKS = ["octant", "sextant", "quadrant"]
SHAPES = [*BLOCKS, "half", "braille", "ascii"]
COLORS = [1 << 24, 256, 16, 0]
COLUMNS, ROWS = 11, 3
WHITE = (255, 255, 255)


def a_frame(cells: Cells, kind: str, columns: int = COLUMNS, rows: int = ROWS) -> U8:
    """Noise, something smooth, or a few flat colours with edges between."""
    across, down = cells.pixels_per_cell(0, 0)
    width, height = columns * across, rows * down
    rng = np.random.default_rng(7)
    if kind == "noise":
        return rng.integers(0, 256, (height, width, 3), dtype=np.uint8)
    if kind == "smooth":
        return gradient(width, height)
    few = rng.integers(0, 256, (3, 3), dtype=np.uint8)
    drawn: U8 = few[np.add.outer(np.arange(height) // 3, np.arange(width) // 5) % 3]
    return drawn


def drawn(cells: Cells, frame: U8, columns: int = COLUMNS, rows: int = ROWS) -> U8:
    cells.forget(None)
    stream = cells.encode(frame, columns, rows, (0, 0)).draw
    return pixels(show(stream, columns, rows), columns, rows, *cells.pixels_per_cell(0, 0), default=WHITE)


def by_cell(picture: U8, across: int, down: int) -> F64:
    """Return the pixels of each cell, [cells, pixels, 3]."""
    height, width = picture.shape[:2]
    split = picture.astype(np.float64).reshape(height // down, down, width // across, across, 3)
    return split.transpose(0, 2, 1, 3, 4).reshape(-1, down * across, 3)


def least_error(cells: F64, *, black: bool = False) -> F64:
    """Return the squared error of the best pattern of each cell, by trying all, with colours not rounded."""
    count = cells.shape[1]
    best = np.full(len(cells), np.inf)
    for pattern in range(1 << count):
        chosen = np.array([bool(pattern >> i & 1) for i in range(count)])
        error = np.zeros(len(cells))
        for side in (chosen, ~chosen):
            if side.any():
                mean = 0.0 if black and side is not chosen else cells[:, side].mean(axis=1, keepdims=True)
                error += ((cells[:, side] - mean) ** 2).sum(axis=(1, 2))
        best = np.minimum(best, error)
    return best


@pytest.mark.parametrize("kind", ["noise", "smooth", "few"])
@pytest.mark.parametrize("name", [*BLOCKS, "braille"])
def test_no_glyph_and_colours_are_better_than_those_a_terminal_shows(name: str, kind: str) -> None:
    cells = Cells(name)
    across, down = cells.pixels_per_cell(0, 0)
    frame = a_frame(cells, kind)
    wanted = by_cell(frame, across, down)
    error = ((by_cell(drawn(cells, frame), across, down) - wanted) ** 2).sum(axis=(1, 2))
    # Colours are whole numbers: half a level away, at most, in each channel of each pixel.
    rounding = 0.25 * 3 * across * down + 0.1
    assert (error <= least_error(wanted, black=name == "braille") + rounding).all()


def test_a_cell_of_more_pixels_shows_the_same_frame_better() -> None:
    frame = a_frame(Cells("octant"), "few", 8, 4)
    errors = [
        np.mean(
            (drawn(Cells(name), frame, 8, 4).repeat(4 // down, 0).repeat(2 // across, 1) - frame.astype(float))
            ** 2
        )
        for name, across, down in (("octant", 2, 4), ("quadrant", 2, 2), ("half", 1, 2))
    ]
    assert errors == sorted(errors)
    assert errors[0] < 0.5 * errors[-1]


@pytest.mark.parametrize("kind", ["noise", "smooth"])
@pytest.mark.parametrize("name", BLOCKS)
def test_of_the_two_colours_of_a_cell_each_pixel_has_the_nearer(name: str, kind: str) -> None:
    cells = Cells(name, 256)
    across, down = cells.pixels_per_cell(0, 0)
    frame = a_frame(cells, kind)
    wanted, shown = by_cell(frame, across, down), by_cell(drawn(cells, frame), across, down)
    for cell, pixels_shown in zip(wanted, shown, strict=True):
        two = np.unique(pixels_shown, axis=0)
        assert len(two) <= 2
        error = ((cell[:, None] - two) ** 2).sum(axis=2)
        assert np.array_equal(((cell - pixels_shown) ** 2).sum(axis=1), error.min(axis=1))


def test_half_blocks_of_16_colours_show_the_nearest_of_a_pixel_moved_by_less_than_a_colour() -> None:
    cells = Cells("half", 16)
    frame = a_frame(cells, "smooth", 16, 8)
    palette = np.array(XTERM_COLORS, np.int64)
    shown = drawn(cells, frame, 16, 8).astype(np.int64)
    moved = np.clip(frame[:, :, None, :].astype(np.int64) + np.arange(-48, 48)[:, None], 0, 255)
    nearest = palette[((moved[..., None, :] - palette) ** 2).sum(axis=-1).argmin(axis=-1)]
    assert (nearest == shown[:, :, None]).all(axis=3).any(axis=2).all()


def test_a_grey_between_two_of_16_colours_becomes_a_mixture_as_bright_as_it_is() -> None:
    grey = np.full((32, 32, 3), 72, np.uint8)
    shown = drawn(Cells("octant", 16), grey, 16, 8)
    assert set(np.unique(shown)) == {0, 127}
    assert abs(shown.mean() - 72) < 12


@pytest.mark.parametrize("colors", COLORS)
@pytest.mark.parametrize("name", SHAPES)
def test_only_the_colours_there_are_get_sent(name: str, colors: int) -> None:
    cells = Cells(name, colors)
    streams = cells.encode(a_frame(cells, "noise"), COLUMNS, ROWS, (0, 0)).draw
    streams += b"".join(cells.lines(a_frame(cells, "smooth")))
    forms = {1 << 24: r"[34]8;2;\d+;\d+;\d+", 256: r"[34]8;5;\d+", 16: r"3[0-7]|4[0-7]|9[0-7]|10[0-7]", 0: "(?!)"}
    found = re.findall(rb"\x1b\[([\d;]*)m", streams)
    form = re.compile(f"({forms[colors]})(;({forms[colors]}))?")
    assert all(parameters == b"0" or form.fullmatch(parameters.decode()) for parameters in found)
    assert (set(found) == {b"0"}) == (colors == 0)


@pytest.mark.parametrize("name", SHAPES)
def test_what_is_printed_without_colours_is_text_and_nothing_else(name: str) -> None:
    cells = Cells(name, 0)
    lines = cells.lines(a_frame(cells, "noise"))
    assert b"\x1b" not in b"".join(lines)
    assert [len(line.decode()) for line in lines] == [COLUMNS + 1] * ROWS


@pytest.mark.parametrize("name", ["octant", "sextant", "quadrant", "half", "braille"])
def test_without_colours_more_pixels_are_lit_the_brighter_it_is(name: str) -> None:
    cells = Cells(name, 0)
    across, down = cells.pixels_per_cell(0, 0)
    shares = []
    for grey in (0, 1, 60, 128, 200, 255):
        frame = np.full((24 * down, 24 * across, 3), grey, np.uint8)
        shares.append(float(drawn(cells, frame, 24, 24).mean()) / 255)
    assert shares[0] == shares[1] == 0
    assert shares[-1] == 1
    assert np.allclose(shares[2:5], [60 / 255, 128 / 255, 200 / 255], atol=0.02)


@pytest.mark.parametrize("name", ["octant", "sextant", "quadrant", "half", "braille"])
def test_without_colours_black_stays_black_and_white_white_pixel_by_pixel(name: str) -> None:
    cells = Cells(name, 0)
    frame = a_frame(cells, "noise")[..., :1].repeat(3, axis=2) // 128 * np.uint8(255)
    assert np.array_equal(drawn(cells, frame), frame)


@pytest.mark.parametrize("colors", COLORS)
def test_ascii_is_as_bright_as_the_picture(colors: int) -> None:
    cells = Cells("ascii", colors)
    greys = np.arange(0, 256, 5)
    frame = greys.astype(np.uint8)[None, :, None].repeat(2, 0).repeat(3, 2)
    stream = cells.encode(frame, len(greys), 1, (0, 0)).draw
    screen = show(stream, len(greys), 1)
    row = [screen.buffer[0][column] for column in range(len(greys))]
    ink = np.array([RAMP[cell.data] for cell in row])
    if colors == 0:
        assert np.abs(255 * ink - greys).max() <= 255 * max(np.diff(list(RAMP.values()))) / 2
        return
    fore = np.array([int(cell.fg[:2], 16) if len(cell.fg) == 6 and cell.data != " " else 0 for cell in row])
    if colors > 256:
        assert np.abs(ink * fore - greys).max() <= 1
    assert (np.diff(ink) >= 0).all() or colors == 16
    assert {cell.bg for cell in row} <= {"000000", "black"}


@pytest.mark.parametrize("name", ["octant", "braille", "ascii", "half"])
def test_a_row_of_one_colour_takes_few_bytes(name: str) -> None:
    cells = Cells(name)
    line = cells.lines(a_frame(cells, "noise", 50, 1) * 0)[0]
    assert len(line) == 50 * (3 if name == "half" else 1) + len(
        b"\x1b[48;2;0;0;0m\x1b[0m\n" if name != "half" else b"\x1b[38;2;0;0;0;48;2;0;0;0m\x1b[0m\n"
    )


def test_a_glyph_is_turned_round_where_its_colours_are_set_the_other_way() -> None:
    red, blue = (200, 0, 0), (0, 0, 200)
    frame = np.empty((2, 4, 3), np.uint8)
    frame[:, 0], frame[:, 1], frame[:, 2], frame[:, 3] = red, blue, blue, red
    (line,) = Cells("quadrant").lines(frame)
    assert line.count(b"\x1b[") == 2
    assert np.array_equal(pixels(show(line, 2, 2), 2, 1, 2, 2), frame)


@pytest.mark.parametrize("name", [*BLOCKS, "braille"])
def test_lines_fill_the_last_cells_with_the_last_pixels(name: str) -> None:
    frame = np.full((5, 5, 3), 90, np.uint8)
    lines = Cells(name).lines(frame)
    across, down = Cells(name).pixels_per_cell(0, 0)
    assert len(lines) == -(-5 // down)
    shown = pixels(show(b"\r".join(lines), 3, len(lines) + 1), 3, len(lines), across, down)
    assert (shown == 90).all()


@settings(max_examples=30)
@given(st.sampled_from(SHAPES), st.sampled_from(COLORS), st.integers(1, 20), st.integers(1, 9), st.integers(0, 99))
def test_a_frame_of_any_size_fills_the_cells_and_nothing_else(
    name: str, colors: int, columns: int, rows: int, seed: int
) -> None:
    frame = np.random.default_rng(seed).integers(1, 256, (7, 9, 3), dtype=np.uint8)
    cells = Cells(name, colors)
    screen = show(cells.encode(frame, columns, rows, (0, 0)).draw, columns + 2, rows + 2, (1, 1))
    for row in range(rows + 2):
        for column in range(columns + 2):
            cell = screen.buffer[row][column]
            inside = 0 < row <= rows and 0 < column <= columns
            assert inside or (cell.data, cell.fg, cell.bg) == (" ", "default", "default")
            assert not inside or (cell.data.isascii() if name == "ascii" else lit(cell.data, 2, 4).shape == (4, 2))
            assert not inside or colors == 0 or cell.bg != "default" or cell.data == FULL_BLOCK


def test_half256_has_256_colours_at_most() -> None:
    assert [Cells("half256", colors).colors for colors in COLORS] == [256, 256, 16, 0]
    assert [Cells("octant", colors).colors for colors in COLORS] == COLORS


def test_a_number_of_colours_that_no_terminal_has_is_refused() -> None:
    with pytest.raises(OptionError, match="colors must be one of 16777216, 256, 16, 0, got 88"):
        Cells("octant", 88)
