"""The examination: this terminal asked, and all that is known of it as a plain document, ready for JSON."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

from tsplat.bench.machine import machine
from tsplat.errors import OptionError, TerminalError
from tsplat.terminal.hearing import LOCAL_SECONDS, Hearing
from tsplat.terminal.interview import Interview, interview
from tsplat.terminal.outputs import choose_output, offers
from tsplat.terminal.probe import Profile, detect

SHOWN: tuple[str, ...] = (
    "TERM",
    "COLORTERM",
    "TERM_PROGRAM",
    "TERM_PROGRAM_VERSION",
    "NO_COLOR",
    "TSPLAT_OUTPUT",
    "COLUMNS",
)
SHOWN += ("LC_ALL", "LC_CTYPE", "LANG", "KITTY_WINDOW_ID", "VTE_VERSION", "KONSOLE_VERSION", "MLTERM")
ONLY_WHETHER_SET = ("SSH_CONNECTION", "SSH_TTY", "TMUX", "STY", "ZELLIJ", "WT_SESSION")
"""Variables whose value says more about a person than about a terminal, such as an address."""

ABILITIES = {
    "synchronized": "synchronized updates (mode 2026)",
    "kitty_keyboard": "key releases (kitty keyboard)",
    "pixel_mouse": "mouse in pixels (mode 1016)",
    "in_band_resize": "size in band (mode 2048)",
}


def examine(environment: Mapping[str, str]) -> dict[str, Any]:
    """Ask this terminal and return what was asked, what came back, what was chosen and why."""
    asked: Interview | None = None
    problem = ""
    if not sys.stdout.isatty():
        problem = "standard output is not a terminal"
    else:
        try:
            asked = interview(environment)
        except TerminalError as error:
            problem = str(error)
    return document(environment, asked, problem)


def document(environment: Mapping[str, str], asked: Interview | None, problem: str = "") -> dict[str, Any]:
    """Return all that is known; without an interview, what the environment tells."""
    hearing = asked.hearing if asked else Hearing((), remote=False)
    profile = detect(environment, hearing.replies, hearing.tmux)
    return {
        "asked": asked is not None,
        "not_asked_because": problem or None,
        "terminal": _terminal(profile, asked.size if asked else (0, 0, 0, 0)),
        "environment": _variables(environment),
        "questions": _questions(hearing),
        "also_came": readable(_unasked(hearing)),
        "tmux": hearing.tmux or None,
        "abilities": {words: getattr(profile, name) for name, words in ABILITIES.items()},
        "outputs": [{"name": offer.name, "offered": offer.offered, "why": offer.why} for offer in offers(profile)],
        "chosen": _chosen(environment, profile),
        "machine": machine(),
    }


def readable(received: bytes) -> str:
    """Return bytes without control characters: ESC and BEL by name, others as Python writes them."""
    text = received.decode("ascii", "backslashreplace")
    names = {"\x1b": " ESC ", "\x07": " BEL "}
    return "".join(names.get(each) or (each if each.isprintable() else repr(each)[1:-1]) for each in text).strip()


def _terminal(profile: Profile, size: tuple[int, int, int, int]) -> dict[str, Any]:
    columns, rows, width, height = size
    return {
        "program": profile.program,
        "version": profile.version,
        "multiplexer": profile.multiplexer or None,
        "remote": profile.remote,
        "colors": profile.colors,
        "columns": columns,
        "rows": rows,
        "pixels_by_the_kernel": [width, height],
        "pixels_by_the_terminal": profile.window_size,
        "cell": profile.cell_size,
        "kitty_transports": profile.kitty_transports if profile.kitty_graphics else [],
    }


def _variables(environment: Mapping[str, str]) -> dict[str, str]:
    shown = {name: environment[name] for name in SHOWN if name in environment}
    return shown | {name: "set" for name in ONLY_WHETHER_SET if environment.get(name)}


def _questions(hearing: Hearing) -> list[dict[str, Any]]:
    rows = []
    for question in hearing.questions:
        reply, seconds = hearing.answer(question) or (None, None)
        rows.append(
            {
                "name": question.name,
                "asked": readable(question.asks),
                "reply": None if reply is None else readable(reply),
                "milliseconds": None if seconds is None else round(1e3 * seconds, 1),
            }
        )
    return rows


def _unasked(hearing: Hearing) -> bytes:
    """Return what came and answers nothing: keys, or answers not known here."""
    rest = hearing.replies
    for question in hearing.questions:
        if answer := hearing.answer(question):
            rest = rest.replace(answer[0], b"", 1)
    return rest


def _chosen(environment: Mapping[str, str], profile: Profile) -> dict[str, str]:
    try:
        name = choose_output(None, environment, profile)
    except OptionError as error:
        return {"output": "", "why": str(error)}
    best = next(offer for offer in offers(profile) if offer.offered)
    if environment.get("TSPLAT_OUTPUT"):
        return {"output": name, "why": f"TSPLAT_OUTPUT says so; else it would be {best.name}"}
    return {"output": name, "why": f"the best one offered: {best.why}"}


def is_late(examination: Mapping[str, Any]) -> bool:
    """Return whether a terminal on this machine answered after the time the viewer gives it at first."""
    last = examination["questions"][-1]["milliseconds"] if examination["questions"] else None
    return not examination["terminal"]["remote"] and last is not None and last > 1e3 * LOCAL_SECONDS
