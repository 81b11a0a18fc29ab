"""JSON of a stranger: however deep, long or large, it is parsed within bounds or refused in a line."""

from __future__ import annotations

import math
import tracemalloc
from pathlib import Path

import pytest

from tsplat.errors import CorruptFileError
from tsplat.io import json_text
from tsplat.io.json_text import parse_json


def corrupt(problem: str, offset: int | None) -> CorruptFileError:
    return CorruptFileError(Path("x.json"), problem, offset)


def parsed(text: bytes) -> object:
    return parse_json(text, dict, "an object", corrupt)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (b"", "at byte 0: is not JSON, expected an object"),
        (b'{"a": }', "at byte 6: is not JSON"),
        (b"\xff{}", "is not JSON"),
        (b'{"a":' * 100_000, "is not JSON"),
        (b"[" * 3_000_000, "holds more than 2097152 values, expected an object"),
        (b"[]", "holds a JSON list, expected an object"),
        (b"NaN", "holds a JSON float, expected an object"),
    ],
)
def test_what_is_no_such_json_is_one_line(text: bytes, problem: str) -> None:
    with pytest.raises(CorruptFileError, match=problem) as caught:
        parsed(text)
    assert str(caught.value).isprintable()


def test_numbers_of_any_length_are_numbers() -> None:
    numbers = {"a": "9" * 1_000_000, "b": "-" + "9" * 5000, "c": "NaN", "d": "-Infinity", "e": "1e999", "f": "7"}
    text = "{" + ", ".join(f'"{name}": {number}' for name, number in numbers.items()) + "}"
    found = parse_json(text.encode(), dict, "an object", corrupt)
    assert math.isnan(found.pop("c"))
    assert found == {"a": math.inf, "b": -math.inf, "d": -math.inf, "e": math.inf, "f": 7}


@pytest.mark.parametrize("part", [b"{}", b"[]", b'{"":0}', b"[[]]", b'"ab"', b"1.5"])
def test_what_is_parsed_takes_a_bounded_share_of_memory(part: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(json_text, "VALUES_MAX", 20_000)
    marks = sum(map(part.count, json_text.BEFORE_VALUES)) + 1
    text = b"[" + b",".join([part] * (19_990 // marks)) + b"]"
    tracemalloc.start()
    try:
        parse_json(text, list, "a list", corrupt)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 120 * 20_000  # so 250 MB of the largest
    with pytest.raises(CorruptFileError, match="holds more than 20000 values"):
        parse_json(text + text, list, "a list", corrupt)
