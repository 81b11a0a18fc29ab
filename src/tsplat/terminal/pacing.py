"""When the next frame may be sent, and how large it may be: learned from the answers that end each frame.

Every frame ends with a question. Its answer says that the frame, and all before it, has arrived and was
drawn. No clock is read here: who calls says what time it is.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from tsplat.errors import TerminalError

MOST_IN_FLIGHT = 2
"""Frames that may wait for an answer; more would only be a queue of old views."""

LATENCY = 0.1
"""Seconds that a frame may take from the first byte to the answer, where nothing else is asked for."""

DEAF_SECONDS = 2.0
"""A terminal that has not answered its first frame for so long never does: it gets frames by the clock."""

STALL_SECONDS = 60.0
"""A terminal that answered before and has not for so long is gone."""

LEAST_SHARE = 1 / 3
"""Of the latency, for sending alone: on a link whose round trip takes all of it, frames must still go."""

FAST = 1e9
"""Bytes a second: what is thought of a link before anything is known."""

MEMORY = 0.6
"""How much of what was learned of the link's rate is kept with every further frame."""

FIRST_PIECE = 16 << 10
"""Bytes of the first piece of a picture; each may have twice as many as the largest answered before it."""


@dataclass(frozen=True, slots=True)
class Quality:
    """How much of a frame is sent.

    Attributes
    ----------
    density : float
        Pixels rendered for each pixel of the output, along either side.
    fidelity : float
        What `tsplat.encode.Encoder.fidelity` says: 1 is all there is.
    exact : bool
        Whether every splat is drawn.
    """

    density: float = 1.0
    fidelity: float = 1.0
    exact: bool = True


FULL = Quality()
LADDER = (
    FULL,
    *(Quality(1.0, fidelity) for fidelity in (0.8, 0.6)),
    *(Quality(density, 0.6) for density in (0.84, 0.71, 0.59)),
    *(Quality(density, 0.4) for density in (0.5, 0.42, 0.35, 0.3)),
    *(Quality(density, 0.2) for density in (0.25, 0.21, 0.18, 0.15, 0.125)),
)
"""Steps down, each with about three quarters of the bytes of the one before."""

STEP = 0.75

START_REMOTE = 10
"""The rung for the first frames over a network of which nothing is known yet."""


@dataclass(slots=True)
class _Sent:
    time: float
    size: int


class Pacer:
    """Watches frames go out and answers come back.

    Parameters
    ----------
    latency : float
        Seconds that a frame may take while the view moves.
    remote : bool
        Whether there is a network in between, so that the first frames are small.
    """

    def __init__(self, latency: float = LATENCY, *, remote: bool = False) -> None:
        self.latency = latency
        self.answers = True
        """False once it is clear that the terminal does not answer."""
        self.round_trip = 0.0
        self._rung = self._next = START_REMOTE if remote else 0
        self._size, self._busy = 0, 0.0
        self._in_flight: deque[_Sent] = deque()
        self._last_answer = float("-inf")
        self._smallest = float("inf")
        self._bytes = self._seconds = 0.0
        self._largest = 0

    @property
    def quality(self) -> Quality:
        """What the next frame gets while the view moves; better by one step at most than the last one."""
        if self._size:
            budget = self.budget(self._busy)
            size, rung = self._size / STEP, max(self._rung - 1, 0)
            if rung == self._rung:
                size *= STEP
            while size > budget and rung < len(LADDER) - 1:
                size, rung = size * STEP, rung + 1
            self._next = rung
        return LADDER[self._next]

    @property
    def rate(self) -> float:
        """Bytes a second that the link and the terminal take."""
        return self._bytes / self._seconds if self._seconds > self._bytes / FAST else FAST

    @property
    def piece(self) -> int:
        """How many bytes of a picture may be sent at once that nobody waits for."""
        return min(self.budget(), max(FIRST_PIECE, 2 * self._largest))

    @property
    def waiting(self) -> int:
        """How many frames have not been answered."""
        return len(self._in_flight)

    def budget(self, busy: float = 0.0) -> int:
        """Return how many bytes of a frame keep the latency, when ``busy`` seconds go into drawing it."""
        seconds = max(self.latency - self.round_trip - busy, LEAST_SHARE * self.latency)
        return int(self.rate * seconds)

    def due(self, now: float) -> float:
        """Return when the next frame may be sent: ``now`` or before it, or when to ask again.

        Raises
        ------
        TerminalError
            The terminal has stopped answering.
        """
        if not self._in_flight:
            return now
        first = self._in_flight[0]
        if not self.answers:
            self._in_flight.clear()
            return now
        if self._last_answer < 0.0 and now - first.time > DEAF_SECONDS:
            self.answers = False
            return now
        if now - first.time > STALL_SECONDS:
            raise TerminalError(f"the terminal has not answered for {STALL_SECONDS:.0f} s")
        if len(self._in_flight) >= MOST_IN_FLIGHT:
            return now + min(DEAF_SECONDS, STALL_SECONDS)
        # The next one leaves when the one before it has left the link: it never waits in a queue on the way.
        return first.time + first.size / self.rate

    def sent(self, now: float, size: int) -> None:
        """Note that a frame of this many bytes, with its question, was sent."""
        if self.answers:
            self._in_flight.append(_Sent(now, size))

    def answered(self, now: float) -> None:
        """Note that the oldest frame was answered; an answer that nobody waits for is none."""
        if not self._in_flight:
            return
        frame = self._in_flight.popleft()
        # What left while the frame before it was still on its way had to wait for it.
        start = max(frame.time, self._last_answer - self.round_trip)
        elapsed = max(now - start, 1e-4)
        self._learn(frame.size, elapsed)
        self._last_answer = now

    def restart(self) -> None:
        """Expect no answer to anything sent so far."""
        self._in_flight.clear()

    def _learn(self, size: int, elapsed: float) -> None:
        if size <= 2 * self._smallest or elapsed < self.round_trip:
            # Small frames tell how long the way is, large ones how wide.
            self._smallest = min(size, self._smallest)
            self.round_trip = elapsed if not self.round_trip else min(elapsed, self.round_trip)
        # Sums, so that what took little time counts little: a moment's jitter is a small frame's whole time.
        self._bytes = MEMORY * self._bytes + size
        self._seconds = MEMORY * self._seconds + max(0.0, elapsed - self.round_trip)
        self._largest = max(self._largest, size)

    def drew(self, size: int, busy: float) -> None:
        """Note how many bytes a moving frame of this `quality` had, and how many seconds it took to draw."""
        self._size, self._busy, self._rung = size, busy, self._next
