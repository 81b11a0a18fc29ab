"""What an error says, and that it survives the way back from a worker process."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from tsplat.errors import CorruptFileError, LoadError, LoadWarning, shown


def test_a_load_error_names_the_file_the_byte_and_the_problem() -> None:
    assert str(LoadError("a.ply", "no splats")) == "a.ply: no splats"
    assert str(CorruptFileError("a.ply", "ends early", offset=7)) == "a.ply: at byte 7: ends early"


def test_escape_sequences_in_a_file_name_do_not_reach_the_terminal() -> None:
    assert str(LoadError("a\x1b[2J\n.ply", "no splats")) == "a\\x1b[2J\\n.ply: no splats"


def test_a_load_error_survives_pickling() -> None:
    error = pickle.loads(pickle.dumps(CorruptFileError("a.ply", "ends early", offset=7)))
    assert type(error) is CorruptFileError
    assert str(error) == "a.ply: at byte 7: ends early"


class Bomb:
    """What must not be looked at."""

    def __repr__(self) -> str:
        raise AssertionError("it was looked at")


DEEP: list[object] = []
for _ in range(100_000):
    DEEP = [DEEP]


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ("a\x1b[2J\u202e", r"'a\x1b[2J\u202e'"),
        ("x" * 1000, "'" + "x" * 55 + "...'"),
        (b"x" * 1000, "b'" + "x" * 54 + "...'"),
        (None, "None"),
        (True, "True"),
        (float("nan"), "nan"),
        (10**9000, "<int of 29898 bits>"),
        ([0] * 60 + [Bomb()], "[" + "0, " * 18 + "0...]"),
        ({"a": [Bomb()], "b": {}}, "{'a': <list>, 'b': {}}"),
        (DEEP, "[<list>]"),
        ((), "()"),
        (np.float32(1.5), "1.5"),
        (np.zeros((10**6, 2)), "<ndarray of shape (1000000, 2)>"),
        (Bomb(), "<Bomb>"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_value_is_shown_short_and_no_more_of_it_is_looked_at(value: object, expected: str) -> None:
    assert shown(value) == expected


def test_a_warning_is_one_line_whatever_a_file_is_called() -> None:
    assert str(LoadWarning("a\x1b[2J\n.ply: dropped 1")) == r"a\x1b[2J\n.ply: dropped 1"
