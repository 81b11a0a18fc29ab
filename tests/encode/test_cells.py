from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pyte
import pytest
from hypothesis import given

from tests.encode.frames import U8, frames, gradient
from tests.encode.screens import XTERM_COLORS, show
from tsplat.encode import palette16
from tsplat.encode.cells import Cells
from tsplat.encode.palette256 import nearest
from tsplat.errors import OptionError


def shown(screen: pyte.Screen, columns: int, rows: int, at: tuple[int, int] = (0, 0)) -> U8:
    """Read the pixels back from the emulator's cells."""
    pixels = np.empty((2 * rows, columns, 3), np.uint8)
    for row in range(rows):
        for column in range(columns):
            cell = screen.buffer[at[1] + row][at[0] + column]
            assert cell.data == "\u2580"
            pixels[2 * row, column] = list(bytes.fromhex(cell.fg))
            pixels[2 * row + 1, column] = list(bytes.fromhex(cell.bg))
    return pixels


def nearest_256(frame: U8) -> U8:
    """Each pixel's nearest colour by looking at all 240."""
    levels = [0, 95, 135, 175, 215, 255]
    palette = [(r, g, b) for r in levels for g in levels for b in levels] + [(v, v, v) for v in range(8, 239, 10)]
    table = np.array(palette, np.int64)
    error = ((frame.reshape(-1, 1, 3).astype(np.int64) - table) ** 2).sum(axis=2)
    nearest: U8 = table[error.argmin(axis=1)].astype(np.uint8).reshape(frame.shape)
    return nearest


@given(frames())
def test_a_terminal_shows_every_pixel(frame: U8) -> None:
    frame = np.repeat(frame, 2, axis=0)
    rows, columns = len(frame) // 2, frame.shape[1]
    stream = Cells("half").encode(frame, columns, rows, (0, 0)).draw
    assert np.array_equal(shown(show(stream, columns, rows), columns, rows), frame)


@given(frames())
def test_a_terminal_with_256_colours_shows_the_nearest(frame: U8) -> None:
    frame = np.repeat(frame, 2, axis=0)
    rows, columns = len(frame) // 2, frame.shape[1]
    stream = Cells("half256").encode(frame, columns, rows, (0, 0)).draw
    pixels = shown(show(stream, columns, rows), columns, rows).astype(np.int64)
    error, best = (
        ((pixels - frame) ** 2).sum(axis=2),
        ((nearest_256(frame).astype(np.int64) - frame) ** 2).sum(axis=2),
    )
    assert np.array_equal(error, best)


def test_every_colour_of_a_fine_grid_gets_its_nearest_of_256() -> None:
    steps = np.arange(0, 256, 11, dtype=np.uint8)
    frame = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(1, -1, 3)
    index = np.array([nearest(*color) for color in frame[0].astype(np.int64)])
    levels = np.array([0, 95, 135, 175, 215, 255])
    cube = levels[np.stack([(index - 16) // 36, (index - 16) // 6 % 6, (index - 16) % 6]) % 6].T
    ours = np.where(index[:, None] < 232, cube, 8 + 10 * (index[:, None] - 232))
    best = nearest_256(frame)[0].astype(np.int64)
    assert np.array_equal(((ours - frame[0]) ** 2).sum(axis=1), ((best - frame[0]) ** 2).sum(axis=1))


def test_every_colour_of_a_fine_grid_gets_its_nearest_of_16() -> None:
    steps = np.arange(0, 256, 15)
    colors = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)
    error = ((colors[:, None] - np.array(XTERM_COLORS)) ** 2).sum(axis=2)
    index = [palette16.nearest(*color) for color in colors]
    assert np.array_equal(error[np.arange(len(colors)), index], error.min(axis=1))


def test_a_picture_drawn_in_the_bottom_right_corner_stays_there_and_scrolls_nothing() -> None:
    frame = gradient(6, 8)
    stream = Cells("half").encode(frame, 6, 4, (0, 0)).draw
    screen = show(b"above\x1b[7;5H" + stream, 10, 10)
    assert np.array_equal(shown(screen, 6, 4, (4, 6)), frame)
    assert screen.display[0] == "above     "
    assert all(line[:4] == "    " for line in screen.display[1:])


def test_a_frame_of_another_size_is_stretched_over_the_cells() -> None:
    blocks = np.zeros((2, 2, 3), np.uint8)
    blocks[0, 0], blocks[1, 1] = (255, 0, 0), (0, 0, 255)
    larger = Cells("half").encode(blocks, 4, 2, (0, 0)).draw
    assert np.array_equal(shown(show(larger, 4, 2), 4, 2), blocks.repeat(2, axis=0).repeat(2, axis=1))
    checks = np.zeros((8, 8, 3), np.uint8)
    checks[::2, ::2] = checks[1::2, 1::2] = 200
    smaller = Cells("half").encode(checks, 4, 2, (0, 0)).draw
    assert np.array_equal(shown(show(smaller, 4, 2), 4, 2), np.full((4, 4, 3), 100, np.uint8))


@given(frames(12))
def test_printed_lines_show_the_frame_and_reset_colours_before_each_line_feed(frame: U8) -> None:
    lines = Cells("half").lines(frame)
    height, columns = frame.shape[:2]
    assert len(lines) == (height + 1) // 2
    assert all(line.endswith(b"\x1b[0m\n") and b"\n" not in line[:-1] for line in lines)
    screen = show(b"".join(lines).replace(b"\n", b"\r\n"), columns, len(lines) + 1)
    whole = height // 2
    assert np.array_equal(shown(screen, columns, whole), frame[: 2 * whole])
    if height % 2:
        last = [screen.buffer[whole][column] for column in range(columns)]
        assert [bytes.fromhex(cell.fg) for cell in last] == [bytes(pixel) for pixel in frame[-1]]
        assert {cell.bg for cell in last} == {"default"}


def test_a_colour_is_sent_once_for_a_run_of_it() -> None:
    black = np.zeros((2, 50, 3), np.uint8)
    assert Cells("half").lines(black) == [b"\x1b[38;2;0;0;0;48;2;0;0;0m" + "\u2580".encode() * 50 + b"\x1b[0m\n"]


@pytest.mark.parametrize("colors", [256, 1 << 24])
def test_the_bytes_are_the_ones_looked_at(colors: int, golden: Callable[[str, bytes], None]) -> None:
    encoder = Cells("half256" if colors == 256 else "half", colors)
    golden(f"{encoder.name}.bin", encoder.encode(gradient(8, 6), 8, 3, (0, 0)).draw)
    golden(f"{encoder.name}_lines.bin", b"".join(encoder.lines(gradient(8, 5))))


@pytest.mark.parametrize("shape", [(4, 4), (4, 4, 4), (0, 4, 3)])
def test_what_is_no_frame_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(OptionError, match=r"frame must be uint8 \[H, W, 3\]"):
        Cells("half").encode(np.zeros(shape, np.uint8), 4, 2, (0, 0))
    with pytest.raises(OptionError, match=r"columns and rows"):
        Cells("half").encode(gradient(2, 2), 0, 2, (0, 0))
