"""How much has come over a network and how fast, in words for the person who waits."""

from __future__ import annotations

import time
from collections import deque

WINDOW = 5.0
"""Seconds over which the speed is a mean: a link that got slow or stopped shows soon."""

QUIET = 2.0
"""Seconds after which it is said that nothing comes."""


class Traffic:
    """Bytes that come; as a str, what to say about them now."""

    def __init__(self) -> None:
        self._size: int | None = None
        self._seen: deque[tuple[float, int]] = deque([(time.perf_counter(), 0)])

    def add(self, done: int, size: int | None) -> None:
        """Note how many bytes have come, and how many there are in all, where that is known."""
        now, self._size = time.perf_counter(), size
        if done > self._seen[-1][1]:
            self._seen.append((now, done))
        while len(self._seen) > 2 and self._seen[1][0] < now - WINDOW:
            self._seen.popleft()

    def __str__(self) -> str:
        now, (last, done) = time.perf_counter(), self._seen[-1]
        come = _amount(done) if self._size is None else _part(done, self._size)
        if now - last > QUIET:
            return f"{come}, nothing for {now - last:.0f} s"
        start, before = self._seen[0]
        return f"{come}, {_amount((done - before) / max(now - start, 1e-3))}/s"


def _part(done: int, size: int) -> str:
    whole, unit = _amount(size).split()
    return f"{_amount(done, unit).split()[0]} of {whole} {unit}"


def _amount(number: float, unit: str = "") -> str:
    if unit == "kB" or (not unit and number < 1e6):
        return f"{number / 1e3:.0f} kB"
    return f"{number / 1e6:.1f} MB"
