"""The conversation with a terminal: all questions in one write, then answers until the last one, or long enough.

By hand rather than with blessed (1.52 looked at): it asks one question after the other, each a round trip
over SSH, keeps no answers to test against, and takes 0.2 s to import.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

from tsplat.terminal.limits import MOST_REPLIES
from tsplat.terminal.multiplexer import ask_tmux
from tsplat.terminal.questions import SENTINEL, Question, is_remote, questions
from tsplat.terminal.trials import Trials

LOCAL_SECONDS = 0.15
"""How long a terminal on this machine may take for all its answers; later ones still count, see `Session`."""

REMOTE_SECONDS = 1.5
"""How long a terminal on another machine may take for its first answer."""

ROUND_TRIPS = 3
"""Times the time of the first answer that the last one may take."""


class Hearing:
    """What a terminal answered so far, when, and how long to go on listening.

    Attributes
    ----------
    questions : tuple of Question
        What was asked.
    replies : bytes
        What came, answers and anything in between.
    tmux : str
        What tmux said about itself and the terminal around it; "" without tmux.
    """

    def __init__(
        self, asked: tuple[Question, ...], *, remote: bool, tmux: str = "", patience: float = 0.0
    ) -> None:
        self.questions, self.replies, self.tmux = asked, b"", tmux
        self._patience = patience
        self._limit = REMOTE_SECONDS if remote else LOCAL_SECONDS
        self._remote = remote
        self._arrived: list[tuple[int, float]] = []

    @property
    def answered(self) -> bool:
        """Whether the answer to the last question is there."""
        return SENTINEL.answer.search(self.replies) is not None

    def left(self, seconds: float) -> float:
        """Return how much longer to listen, ``seconds`` after asking; 0 when all is said, or more than answers."""
        if self.answered or len(self.replies) > MOST_REPLIES:
            return 0.0
        return max(0.0, max(self._limit, self._patience) - seconds)

    def take(self, received: bytes, seconds: float) -> None:
        """Note what came ``seconds`` after asking."""
        if self._remote and b"\x1b" in received and b"\x1b" not in self.replies:  # not a key typed meanwhile
            self._limit = max(LOCAL_SECONDS, ROUND_TRIPS * seconds)
        self.replies += received
        self._arrived.append((len(self.replies), seconds))

    def answer(self, question: Question) -> tuple[bytes, float] | None:
        """Return the answer to a question as it came, and the seconds it took; None where there is none."""
        match = question.answer.search(self.replies)
        if match is None:
            return None
        return match[0], next(seconds for end, seconds in self._arrived if end >= match.end())


def ask(
    environment: Mapping[str, str],
    send: Callable[[bytes], None],
    receive: Callable[[float], bytes],
    patience: float = 0.0,
) -> Hearing:
    """Ask a terminal everything and return what it answered.

    Parameters
    ----------
    environment : mapping of str to str
        Environment variables.
    send : callable
        Writes bytes to the terminal.
    receive : callable
        Returns what the terminal sent, b"" when nothing came for so many seconds.
    patience : float
        Seconds to wait for the last answer at least.
    """
    with Trials(environment) as trials:
        asked = questions(environment, trials.questions)
        hearing = Hearing(asked, remote=is_remote(environment), tmux=ask_tmux(environment), patience=patience)
        send(b"".join(question.asks for question in asked))
        start = time.monotonic()
        while (left := hearing.left(time.monotonic() - start)) > 0:
            if received := receive(left):
                hearing.take(received, time.monotonic() - start)
    return hearing
