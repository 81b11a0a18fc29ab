"""Options and fixtures of the whole suite."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import settings

from tsplat.warmup import draw_tiny

# A first call compiles kernels; time is no property worth failing for.
settings.register_profile("tsplat", deadline=None)
settings.load_profile("tsplat")

# Whoever starts the tests may ignore these, as nohup and the background of shells do; what we start would, too.
# What is caught here is as usual there.
for _name in ("SIGINT", "SIGHUP", "SIGTERM", "SIGQUIT", "SIGTSTP"):
    if signal.getsignal(getattr(signal, _name, signal.SIGINT)) is signal.SIG_IGN:
        _caught = signal.default_int_handler if _name == "SIGINT" else lambda *_: None
        signal.signal(getattr(signal, _name), _caught)

GOLDENS = Path(__file__).parent / "goldens"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--update-goldens", action="store_true", help="rewrite tests/goldens from what the code does now"
    )


@pytest.fixture(scope="session")
def compiled() -> None:
    """Have the kernels ready, so that no command stops to say that it compiles them."""
    draw_tiny()


@pytest.fixture
def golden(request: pytest.FixtureRequest) -> Callable[[str, bytes], None]:
    """Compare bytes with a file of tests/goldens; `--update-goldens` writes it instead."""

    def compare(name: str, actual: bytes) -> None:
        path = GOLDENS / name
        if request.config.getoption("--update-goldens"):
            GOLDENS.mkdir(exist_ok=True)
            path.write_bytes(actual)
        assert path.exists(), f"{path} is missing; run pytest --update-goldens and look at what it writes"
        assert actual == path.read_bytes()

    return compare
