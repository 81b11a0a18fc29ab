"""The pacer on links that exist as numbers only: what leaves, when, how large, and what becomes of it."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest

from tsplat.errors import TerminalError
from tsplat.terminal.pacing import DEAF_SECONDS, FULL, LADDER, MOST_IN_FLIGHT, STALL_SECONDS, Pacer

WHOLE = 500_000
"""Bytes of a frame with everything in it."""


def size_of(pacer: Pacer) -> int:
    """Return what a frame of the pacer's quality has, roughly as encoders do."""
    return int(WHOLE * pacer.quality.density**2 * pacer.quality.fidelity) + 200


@dataclass
class Link:
    """Bytes leave one after the other at a rate; a frame's answer comes a round trip after its last byte left."""

    rate: float
    round_trip: float
    free: float = 0.0
    answers: list[float] = field(default_factory=list)

    def send(self, now: float, size: int) -> float:
        self.free = max(self.free, now) + size / self.rate
        self.answers.append(self.free + self.round_trip)
        return self.answers[-1]


@dataclass
class Run:
    """What happened: for each frame when it was sent, when it was answered, how large it was."""

    frames: list[tuple[float, float, int]] = field(default_factory=list)
    most_waiting: int = 0


def drive(pacer: Pacer, link: Link, seconds: float, drawing: float = 0.02, start: float = 0.0) -> Run:
    """Turn the view for a while: draw and send whenever the pacer lets us."""
    run, now, end = Run(), start, start + seconds
    pacer.sent(now, 4)
    link.send(now, 4)
    while now < end:
        due = pacer.due(now)
        if due <= now:
            size = size_of(pacer)
            now += drawing
            while link.answers and link.answers[0] <= now:
                pacer.answered(link.answers.pop(0))
            pacer.sent(now, size)
            run.frames.append((now, link.send(now, size), size))
            run.most_waiting = max(run.most_waiting, pacer.waiting)
            pacer.drew(size, drawing)
        else:
            now = min([due, *link.answers[:1]])
            while link.answers and link.answers[0] <= now:
                pacer.answered(link.answers.pop(0))
    return run


@pytest.mark.parametrize(("mbit", "slowest"), [(100, 0.1), (10, 0.11), (1, 0.25)])
def test_frames_arrive_in_time_on_links_of_every_width(mbit: float, slowest: float) -> None:
    run = drive(Pacer(remote=True), Link(mbit * 1e6 / 8, 0.04), 5.0)
    late = [answered - sent for sent, answered, _ in run.frames[5:]]
    assert len(late) > 20
    assert sorted(late)[len(late) // 2] <= slowest


def test_no_more_than_two_frames_wait_for_an_answer() -> None:
    for rate in (1e4, 1e6, 1e8):
        assert 1 <= drive(Pacer(), Link(rate, 0.2), 10.0).most_waiting <= MOST_IN_FLIGHT


def test_a_frame_leaves_only_when_the_link_is_nearly_free() -> None:
    pacer, link = Pacer(remote=True), Link(1.25e5, 0.04)
    run = drive(pacer, link, 6.0)
    for (_, answered, _), (sent, _, _) in list(zip(run.frames, run.frames[1:], strict=False))[8:]:
        assert sent >= answered - link.round_trip - 0.03


def test_a_terminal_on_this_machine_gets_whole_frames() -> None:
    pacer = Pacer(remote=True)
    drive(pacer, Link(2e8, 0.001), 3.0)
    assert pacer.quality == FULL


def test_a_slow_terminal_on_this_machine_gets_less_until_it_keeps_up() -> None:
    pacer = Pacer()
    run = drive(pacer, Link(6e5, 0.001), 3.0)
    assert LADDER.index(pacer.quality) > 3
    assert run.frames[-1][1] - run.frames[-1][0] < 0.15


def test_a_link_that_widens_gets_better_frames_again() -> None:
    pacer, link = Pacer(remote=True), Link(1.25e5, 0.04)
    drive(pacer, link, 4.0)
    narrow = pacer.quality
    link.rate = 1.25e7
    while link.answers:
        pacer.answered(link.answers.pop(0))
    drive(pacer, link, 6.0, start=60.0)
    assert LADDER.index(pacer.quality) < LADDER.index(narrow) - 3


def test_after_a_stall_no_queue_of_old_frames_is_waiting() -> None:
    pacer = Pacer()
    for moment in (0.0, 0.2):
        assert pacer.due(moment) <= moment
        pacer.sent(moment, 1000)
    assert all(pacer.due(moment) > moment for moment in (0.3, 1.0, 1.9))
    pacer.answered(5.0)
    pacer.answered(5.0)
    assert pacer.due(5.0) <= 5.0


def test_a_terminal_that_never_answers_gets_frames_by_the_clock() -> None:
    pacer = Pacer()
    pacer.sent(0.0, 4)
    pacer.sent(0.1, 1000)
    assert pacer.due(1.0) > 1.0
    assert pacer.due(DEAF_SECONDS + 0.1) <= DEAF_SECONDS + 0.1
    assert not pacer.answers
    pacer.sent(3.0, 1000)
    assert pacer.due(3.0) <= 3.0
    assert pacer.waiting == 0


def test_a_terminal_that_stops_answering_ends_the_session() -> None:
    pacer = Pacer()
    pacer.sent(0.0, 4)
    pacer.answered(0.01)
    pacer.sent(1.0, 1000)
    pacer.due(STALL_SECONDS)
    with pytest.raises(TerminalError, match="has not answered for 60 s"):
        pacer.due(STALL_SECONDS + 1.5)


def test_an_answer_that_nobody_waits_for_changes_nothing() -> None:
    pacer = Pacer()
    pacer.answered(1.0)
    assert (pacer.waiting, pacer.round_trip, pacer.quality) == (0, 0.0, FULL)


def test_the_latency_asked_for_sets_the_size_of_frames() -> None:
    sizes = []
    for latency in (0.08, 0.3):
        run = drive(Pacer(latency, remote=True), Link(1.25e6, 0.04), 5.0)
        sizes.append(run.frames[-1][2])
    assert sizes[1] > 2 * sizes[0]
