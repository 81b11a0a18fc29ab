"""Asciicasts, read by a reader of our own and shown by a terminal emulator."""

from __future__ import annotations

import io

import numpy as np
import pytest

from tests.encode.frames import gradient
from tests.record.casts import Event, read_cast, screen_of
from tsplat.encode import ENCODERS, encoder
from tsplat.record.cast import CELLS, Cast, write_orbit

COLUMNS, ROWS = 20, 6


def orbit(frames: list[np.ndarray], fps: int = 20) -> bytes:
    file = io.BytesIO()
    write_orbit(file, frames, encoder("half"), (COLUMNS, ROWS), fps, title="x")
    return file.getvalue()


def moving(count: int) -> list[np.ndarray]:
    return [np.roll(gradient(COLUMNS, 2 * ROWS), index, axis=1) for index in range(count)]


def test_a_terminal_shows_each_frame_at_its_time() -> None:
    frames = moving(5)
    header, events = read_cast(orbit(frames))
    assert (header["term"]["cols"], header["term"]["rows"], header["title"]) == (COLUMNS, ROWS, "x")
    for index, frame in enumerate(frames):
        assert events[index].seconds == pytest.approx(index / 20)
        screen = screen_of(header, events[: index + 1])
        assert screen.cursor.hidden
        for y, row in enumerate(frame):
            for x, pixel in enumerate(row):
                cell = screen.buffer[y // 2][x]
                assert (cell.fg if y % 2 == 0 else cell.bg) == bytes(pixel).hex()


def test_it_begins_on_a_screen_of_its_own_and_gives_it_back() -> None:
    header, events = read_cast(orbit(moving(3)))
    assert events[0].text.startswith("\x1b[?1049h\x1b[?25l\x1b[2J\x1b[H")
    assert events[-2].text.endswith("\x1b[?25h\x1b[?1049l")
    assert not screen_of(header, events).cursor.hidden
    assert events[-1] == Event(0.15, "x", "0")
    assert [event.kind for event in events] == ["o"] * 4 + ["x"]


@pytest.mark.parametrize("fps", [7, 24, 30, 60])
def test_intervals_add_up_to_the_true_time(fps: int) -> None:
    _, events = read_cast(orbit(moving(2) * 100, fps))
    assert events[-1].seconds == pytest.approx(200 / fps, abs=0.00051)


def recorded(*written: bytes) -> list[Event]:
    """Return the events of a recording of these writes, a second apart."""
    file = io.BytesIO()
    cast = Cast(file, 9, 3)
    for index, screen in enumerate(written):
        cast.output(index, screen)
    cast.end(len(written))
    return read_cast(file.getvalue())[1]


def test_a_character_that_two_writes_share_comes_whole_with_the_second() -> None:
    block = "\u2580".encode()
    events = recorded(b"a" + block[:1], block[1:2], block[2:] + b"b")
    assert events[:2] == [Event(0.0, "o", "a"), Event(2.0, "o", "\u2580b")]


def test_bytes_that_are_no_text_are_marked_and_lose_nothing_else() -> None:
    events = recorded(b"a\xffb", b"c\xe2\x96")
    assert [event.text for event in events[:3]] == ["a\ufffdb", "c", "\ufffd"]


def test_what_json_must_escape_comes_back() -> None:
    screen = '\x1b[1m"\\\r\n\t\x00\x7f\u2580'
    assert recorded(screen.encode())[0].text == screen


def test_a_resize_is_an_event() -> None:
    file = io.BytesIO()
    cast = Cast(file, 9, 3, timestamp=7)
    cast.resize(0.5, 120, 40)
    cast.end(1.0)
    header, events = read_cast(file.getvalue())
    assert events[0] == Event(0.5, "r", "120x40")
    assert header["timestamp"] == 7
    assert (screen_of(header, events).columns, screen_of(header, events).lines) == (120, 40)


def test_time_never_goes_back() -> None:
    file = io.BytesIO()
    cast = Cast(file, 9, 3)
    for seconds in (1.0, 0.2, 1.1):
        cast.output(seconds, b"x")
    cast.end(0.0)
    _, events = read_cast(file.getvalue())
    assert [event.seconds for event in events] == [1.0, 1.0, 1.1, 1.1, 1.1]


def test_progress_is_told_of_each_frame() -> None:
    told: list[float] = []
    frames = moving(4)
    write_orbit(io.BytesIO(), frames, encoder("half"), (COLUMNS, ROWS), 20, title="x", progress=told.append)
    assert told == [0.25, 0.5, 0.75, 1.0]


def test_cells_are_the_outputs_that_are_text() -> None:
    assert {"half", "half256"} <= set(CELLS) < set(ENCODERS)
    for name in CELLS:
        across, down = encoder(name).pixels_per_cell(10, 20)
        encoded = encoder(name).encode(gradient(COLUMNS * across, ROWS * down), COLUMNS, ROWS, (10, 20))
        assert not encoded.upload
        assert b"\x1b_" not in encoded.draw
        assert b"\x1bP" not in encoded.draw
        assert b"\x1b]" not in encoded.draw
