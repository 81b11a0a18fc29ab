from __future__ import annotations

import hashlib
import re
import unicodedata

import pyte
import pytest
from pyte.graphics import FG_BG_256

from tests.encode.frames import gradient
from tests.encode.test_kitty import commands
from tsplat.encode.kitty import Kitty
from tsplat.encode.placeholders import MARKS, placeholder_cells

PLACEHOLDER = "\U0010eeee"
PASSTHROUGH = re.compile(rb"\x1bPtmux;((?:[^\x1b]|\x1b\x1b)*)\x1b\\")


def through(stream: bytes) -> tuple[bytes, bytes]:
    """Do as tmux does: what it passes on as it is, and what it draws itself."""
    passed = b"".join(match[1].replace(b"\x1b\x1b", b"\x1b") for match in PASSTHROUGH.finditer(stream))
    return passed, PASSTHROUGH.sub(b"", stream)


def screen_of(text: bytes) -> pyte.Screen:
    # One column more than any test draws: pyte takes a mark after the last column to the next line.
    screen = pyte.Screen(13, 8)
    pyte.Stream(screen).feed("\x1b[3;4H" + text.decode())
    return screen


def test_the_marks_are_those_of_the_protocol() -> None:
    # The digest is of the first fields of the 297 lines of kitty's rowcolumn-diacritics.txt.
    codes = " ".join(f"{ord(mark):04X}" for mark in MARKS)
    assert hashlib.sha256(codes.encode()).hexdigest() == (
        "c3dd25224e1c644f2840932c2e136a30bcf3d2e19fba60c1d3b210559106ad54"
    )


def test_no_mark_moves_or_merges_when_text_is_normalized() -> None:
    assert all(unicodedata.combining(mark) == 230 for mark in MARKS)
    cells = "".join(PLACEHOLDER + one + other for one, other in zip(MARKS, reversed(MARKS), strict=True))
    assert all(unicodedata.normalize(form, cells) == cells for form in ("NFC", "NFD", "NFKC", "NFKD"))


@pytest.mark.parametrize(("columns", "rows"), [(1, 1), (5, 3), (9, 6)])
def test_each_cell_says_its_row_and_column_and_whose_it_is(columns: int, rows: int) -> None:
    screen = screen_of(placeholder_cells(115, columns, rows))
    shown = {(y, x): cell for y, line in screen.buffer.items() for x, cell in line.items() if cell.data != " "}
    assert set(shown) == {(2 + row, 3 + column) for row in range(rows) for column in range(columns)}
    for (y, x), cell in shown.items():
        assert cell.data == PLACEHOLDER + MARKS[y - 2] + MARKS[x - 3]
        assert cell.fg == FG_BG_256[115]


def test_text_after_the_cells_has_the_colours_of_the_terminal_whatever_came_before() -> None:
    screen = screen_of(b"\x1b[31m" + placeholder_cells(115, 2, 2) + b"\x1b[Hx")
    assert screen.buffer[0][0].fg == "default"


def test_tmux_passes_on_the_upload_that_the_terminal_would_have_had() -> None:
    passed, drawn = through(Kitty(tmux=True).encode(gradient(90, 60), 9, 3, (10, 20)).upload)
    direct = Kitty().encode(gradient(90, 60), 9, 3, (10, 20)).upload
    assert drawn == b""
    assert [payload for _, payload in commands(passed)] == [payload for _, payload in commands(direct)]


def test_the_cells_stand_for_the_virtual_placement_that_goes_before_them() -> None:
    kitty = Kitty(tmux=True)
    seen = []
    for _ in range(4):
        encoded = kitty.encode(gradient(9, 6), 5, 3, (10, 20))
        uploaded = commands(through(encoded.upload)[0])[0][0]["i"]
        passed, drawn = through(encoded.draw)
        ((keys, _),) = commands(passed)
        assert keys.items() >= {"a": "p", "U": "1", "i": uploaded, "c": "5", "r": "3", "q": "2"}.items()
        assert screen_of(drawn).buffer[2][3].fg == FG_BG_256[int(uploaded)]
        seen.append(uploaded)
    assert seen[0] == seen[2] != seen[1] == seen[3]


def test_a_picture_wider_than_there_are_marks_is_squeezed_into_as_many_cells() -> None:
    passed, drawn = through(Kitty(tmux=True).encode(gradient(9, 6), 400, 2, (10, 20)).draw)
    assert commands(passed)[0][0]["c"] == "297"
    assert drawn.decode().count(PLACEHOLDER) == 2 * 297


def test_clearing_goes_through_tmux_and_frees_both_pictures() -> None:
    kitty = Kitty(tmux=True)
    sent = {commands(through(kitty.encode(gradient(3, 3), 2, 2, (1, 1)).upload)[0])[0][0]["i"] for _ in range(3)}
    passed, drawn = through(kitty.clear())
    assert drawn == b""
    assert {(keys["a"], keys["d"], keys["i"]) for keys, _ in commands(passed)} == {("d", "I", i) for i in sent}
