"""What is said while a scene is fetched and loaded: in words, and on a terminal."""

from __future__ import annotations

import io
import sys

import pytest

from tests.terminal.ptys import Terminal
from tsplat import progress, traffic
from tsplat.traffic import WINDOW, Traffic


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Return a list whose number is the time."""
    now = [100.0]
    monkeypatch.setattr(traffic.time, "perf_counter", lambda: now[0])  # type: ignore[attr-defined]
    return now


@pytest.mark.parametrize(
    ("done", "size", "words"),
    [
        (500_000, None, "500 kB, 250 kB/s"),
        (2_500_000, None, "2.5 MB, 1.2 MB/s"),
        (40_000, 90_000, "40 of 90 kB, 20 kB/s"),
        (40_000, 90_000_000, "0.0 of 90.0 MB, 20 kB/s"),
        (12_340_000, 45_000_000, "12.3 of 45.0 MB, 6.2 MB/s"),
        (0, 45_000_000, "0.0 of 45.0 MB, 0 kB/s"),
    ],
)
def test_traffic_is_said_in_units_of_the_whole(
    clock: list[float], done: int, size: int | None, words: str
) -> None:
    heard = Traffic()
    clock[0] += 2.0
    heard.add(done, size)
    assert str(heard) == words


def test_the_speed_is_that_of_the_last_seconds(clock: list[float]) -> None:
    heard = Traffic()
    for second in range(20):
        clock[0] += 1.0
        heard.add(3_000_000 * min(second + 1, 10) + 1_000_000 * max(0, second - 9), None)
    assert str(heard) == "40.0 MB, 1.0 MB/s"
    assert clock[0] - 100.0 > 2 * WINDOW


def test_a_link_that_stopped_is_noticed_while_nothing_comes(clock: list[float]) -> None:
    heard = Traffic()
    heard.add(1_000_000, None)
    for _ in range(9):
        clock[0] += 1.0
        heard.add(1_000_000, None)
    assert str(heard) == "1.0 MB, nothing for 9 s"


def test_a_terminal_sees_what_comes_and_then_what_is_read_and_then_nothing() -> None:
    script = """
import time
from tsplat import progress
progress.BAR_AFTER = 0.0
with progress.loading("[b]scene.spz", doing="loading") as bar:
    bar.fetched(0, None)
    time.sleep(0.3)
    bar.fetched(30_000_000, 60_000_000)
    bar(0.375)
    time.sleep(0.3)
    bar(0.8)
    bar(0.9)
    time.sleep(0.3)
print("end")
"""
    with Terminal.python(script) as terminal:
        at = terminal.wait_for(
            b"fetching [b]scene.spz", b"0 kB", b"30.0 of 60.0 MB", b"loading [b]scene.spz", b"90%"
        )
        at = terminal.wait_for(b"\x1b[2K", b"end", start=at)
        assert b"MB/s" not in terminal.seen[terminal.seen.rindex(b"loading") : at]
        assert terminal.wait() == 0


def test_without_a_terminal_nothing_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    said = io.StringIO()
    monkeypatch.setattr(sys, "stderr", said)
    monkeypatch.setattr(progress, "BAR_AFTER", 0.0)
    with progress.loading("scene.spz") as bar:
        bar.fetched(5, None)
        bar(0.5)
    assert said.getvalue() == ""
