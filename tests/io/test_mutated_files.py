"""Thousands of broken files of every format: each is a scene, or one line that says what is wrong with it."""

from __future__ import annotations

import json
import signal
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import NoReturn

import pytest

from tests.io.honest_files import HONEST, Files, written
from tests.io.mutants import liars, mutant
from tests.io.outcomes import OPTIONS, limited_growth, outcome, read_or_refused, within_memory
from tests.io.side_files import SIDE, looked_at
from tsplat import io

MUTANTS, MUTANTS_OF_SOG = 100, 40
"""Of each honest file; a SOG takes ten times as long as any other."""

TRACED = 4
"""Of so many mutants the memory of one is measured, which takes most of the time."""

BATCH_SECONDS = 60
"""A batch takes a second; a file that keeps a reader for so long would keep it for ever."""

ROOM_BYTES = 1 << 30
"""What the process may grow by: threads reserve addresses for themselves, but files that lie promise far more."""


def damaged(name: str) -> Iterator[Files]:
    """Yield the files of a scene again and again, one of them damaged, then with counts that lie in the first."""
    files = HONEST[name]
    for number in range(MUTANTS_OF_SOG if name.startswith("SOG") else MUTANTS):
        random = Random(f"{name} {number}")
        chosen = random.choice(list(files))
        yield {**files, chosen: mutant(random, files[chosen], list(files.values()))}
    first = next(iter(files))
    for lie in liars(files[first]):
        yield {**files, first: lie}


@pytest.fixture
def bounded() -> Iterator[None]:
    """Let memory that is asked for by mistake be refused, and a reader that hangs fail."""

    def hang(*_: object) -> NoReturn:
        pytest.fail(f"a reader was still busy after {BATCH_SECONDS} seconds")

    handler = signal.signal(signal.SIGALRM, hang)
    signal.alarm(BATCH_SECONDS)
    with limited_growth(ROOM_BYTES):
        yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, handler)


@pytest.mark.usefixtures("bounded")
@pytest.mark.parametrize("name", HONEST)
def test_a_damaged_file_is_a_scene_or_one_line_that_says_why_not(tmp_path: Path, name: str) -> None:
    honest = outcome(written(tmp_path, HONEST[name]))
    assert honest is not None
    outcomes = []
    for number, files in enumerate(damaged(name)):
        path, options = written(tmp_path, files), OPTIONS[number // TRACED % len(OPTIONS)]
        if number % TRACED:
            outcomes.append(outcome(path, **options) is not None)
        else:
            outcomes.append(within_memory(path, honest.nbytes, **options) is not None)
    assert 3 < sum(outcomes) < len(outcomes) - 3, "they are neither all broken nor all harmless"


@pytest.mark.usefixtures("bounded")
@pytest.mark.parametrize("name", SIDE)
def test_a_damaged_file_beside_a_scene_is_a_calm_line_at_most(tmp_path: Path, name: str) -> None:
    files, told = SIDE[name], 0
    for number in range(MUTANTS):
        random = Random(f"{name} {number}")
        chosen = random.choice(list(files))
        damaged = {**files, chosen: mutant(random, files[chosen], list(files.values()))}
        told += looked_at(written(tmp_path, damaged)).focal is not None
    assert told < MUTANTS - 3
    assert (told > 3) == (name != "panorama")


@pytest.mark.usefixtures("bounded")
def test_a_damaged_list_of_cameras_is_one_or_a_line_that_says_why_not(tmp_path: Path) -> None:
    axes = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    place = {"width": 640, "height": 480, "position": [1, 2, 3], "rotation": axes, "fx": 500.0, "fy": 510.0}
    text = json.dumps([{"id": index, "img_name": "one", **place} for index in range(2)]).encode()
    path, read = tmp_path / "cameras.json", 0
    for number in range(4 * MUTANTS):
        path.write_bytes(mutant(Random(number), text))
        read += read_or_refused(path, lambda: io.load_cameras(path)) is not None
    assert 10 < read < 4 * MUTANTS - 10
