"""What an error says, and that it survives the way back from a worker process."""

from __future__ import annotations

import pickle

from tsplat.errors import CorruptFileError, LoadError


def test_a_load_error_names_the_file_the_byte_and_the_problem() -> None:
    assert str(LoadError("a.ply", "no splats")) == "a.ply: no splats"
    assert str(CorruptFileError("a.ply", "ends early", offset=7)) == "a.ply: at byte 7: ends early"


def test_escape_sequences_in_a_file_name_do_not_reach_the_terminal() -> None:
    assert str(LoadError("a\x1b[2J\n.ply", "no splats")) == "a\\x1b[2J\\n.ply: no splats"


def test_a_load_error_survives_pickling() -> None:
    error = pickle.loads(pickle.dumps(CorruptFileError("a.ply", "ends early", offset=7)))
    assert type(error) is CorruptFileError
    assert str(error) == "a.ply: at byte 7: ends early"
