"""Terminals for the tests, one at a time, or the reason why there is none."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.e2e.terminals import RECIPES, NotInstallableError
from tests.e2e.visit import Case, Visit
from tsplat.io import demo_path, load
from tsplat.scene import Gaussians


@pytest.fixture(scope="session")
def demo() -> tuple[Path, Gaussians]:
    """The scene that everybody has."""
    path = demo_path()
    return path, load(path)


@pytest.fixture
def visit(
    compiled: None,  # noqa: ARG001
    demo: tuple[Path, Gaussians],
    tmp_path: Path,
) -> Iterator[Callable[[Case], Visit]]:
    """Open a terminal with the viewer ready to begin; it is closed after the test."""
    opened: list[Visit] = []

    def open_it(case: Case) -> Visit:
        if missing := RECIPES[case.terminal].missing():
            not_there(f"{case.terminal} needs: apt-get install {' '.join(missing)}")
        try:
            opened.append(Visit(case, *demo, tmp_path))
        except NotInstallableError as error:
            not_there(str(error))
        return opened[-1]

    yield open_it
    for each in opened:
        each.terminal.close()


def not_there(reason: str) -> None:
    """Skip the test; in CI, where all terminals have to be, fail it."""
    if os.environ.get("CI") == "true":
        pytest.fail(reason)
    pytest.skip(reason)
