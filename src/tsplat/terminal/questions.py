"""What a terminal is asked, in one batch, and what an answer looks like. Knows nothing of what follows from it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Question:
    """A question to the terminal.

    Attributes
    ----------
    name : str
        What `Profile.replies` calls the answer.
    asks : bytes
        What is written.
    answer : Pattern
        What comes back where the terminal knows the question; its group is the part that says something, in
        printable ASCII, and no longer than any terminal says it.
    """

    name: str
    asks: bytes
    answer: re.Pattern[bytes]


def _mode(number: int) -> Question:
    return Question(f"mode {number}", b"\x1b[?%d$p" % number, re.compile(rb"\x1b\[\?%d;(\d{1,3})\$y" % number))


def graphics_question(name: str, number: int, keys: str, payload: bytes) -> Question:
    """Return whether the terminal can take one pixel of kitty graphics, its data found in some way."""
    asks = b"\x1b_Gi=%d,s=1,v=1,a=q,f=24,%s;%s\x1b\\" % (number, keys.encode(), payload)
    return Question(name, asks, re.compile(rb"\x1b_Gi=%d;([ -~]{0,200})\x1b\\" % number))


CELL_SIZE = Question("cell 16t", b"\x1b[16t", re.compile(rb"\x1b\[6;(\d{1,5};\d{1,5})t"))
WINDOW_SIZE = Question("window 14t", b"\x1b[14t", re.compile(rb"\x1b\[4;(\d{1,5};\d{1,5})t"))
GRAPHICS = graphics_question("kitty graphics", 31, "t=d", b"AAAA")
SENTINEL = Question("DA1", b"\x1b[c", re.compile(rb"\x1b\[\?([\d;]{0,100})c"))
"""Every terminal answers this one, and all answer in order: after it, nothing more comes."""

_COMMON = (
    Question("XTVERSION", b"\x1b[>0q", re.compile(rb"\x1bP>\|([ -~]{0,100})\x1b\\")),
    CELL_SIZE,
    WINDOW_SIZE,
    _mode(2026),
    _mode(1016),
    _mode(2048),
    Question("sixel size", b"\x1b[?2;4;0S", re.compile(rb"\x1b\[\?2;0;(\d{1,5};\d{1,5})S")),
    Question("kitty keyboard", b"\x1b[?u", re.compile(rb"\x1b\[\?(\d{1,3})u")),
)
TRANSPORTS = {"shared": 32, "file": 33}
"""Ways of `Profile.kitty_transports` that are tried, with the numbers that tell the answers apart."""


def transport_question(transport: str, payload: bytes = b"") -> Question:
    """Return whether the terminal finds what lies under the name in ``payload``, in base64."""
    return graphics_question(
        f"kitty {transport}", TRANSPORTS[transport], f"t={transport[0].replace('f', 't')}", payload
    )


_KNOWN = (*_COMMON, GRAPHICS, *map(transport_question, TRANSPORTS), SENTINEL)


def prints_graphics(environment: Mapping[str, str]) -> bool:
    """Return whether a question about kitty graphics shows on screen: in Terminal.app, or as tmux's title."""
    return bool(multiplexer(environment)) or environment.get("TERM_PROGRAM") == "Apple_Terminal"


def questions(environment: Mapping[str, str], trials: Iterable[Question] = ()) -> tuple[Question, ...]:
    """Return what to ask a terminal, in one write; the last question is one that every terminal answers."""
    if environment.get("TERM", "") in ("", "dumb", "linux"):
        return (SENTINEL,)
    graphics = () if prints_graphics(environment) else (GRAPHICS, *trials)
    return (*_COMMON, *graphics, SENTINEL)


def multiplexer(environment: Mapping[str, str]) -> str:
    """Return "tmux", "screen" or "zellij" as the environment tells, "" where it names none."""
    term = environment.get("TERM", "")
    for name, variable in (("tmux", "TMUX"), ("screen", "STY"), ("zellij", "ZELLIJ")):
        if environment.get(variable) or term.startswith(name):
            return name
    return ""


def is_remote(environment: Mapping[str, str]) -> bool:
    """Return whether the terminal is on another machine, over SSH."""
    return bool(environment.get("SSH_CONNECTION") or environment.get("SSH_TTY"))


def said(replies: bytes) -> dict[str, str]:
    """Return the answers by the names of their questions, readable, whatever is in between."""
    found = {question.name: question.answer.search(replies) for question in _KNOWN}
    return {name: match[1].decode("ascii", "replace") for name, match in found.items() if match}
