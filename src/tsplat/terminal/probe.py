"""What this terminal can do: one batch of questions, and a pure function from the answers to a `Profile`.

By hand rather than with blessed, which asks one question at a time, each a round trip over SSH, and
keeps no answers to test against. Source of the terminals' ways: measured, see tests/terminal/test_probe.py.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from tsplat.errors import OptionError

OUTPUTS = ("kitty", "sixel", "half", "half256")
"""Names of all encoders, best picture first; `tsplat.encode.ENCODERS` has the same."""

TIMEOUT, REMOTE_TIMEOUT = 0.5, 1.5
"""Seconds to wait for the answers. Every terminal measured answers DA1, so only a pipe posing as a
terminal ever waits that long, while a terminal that is still starting needs more than a moment."""

_GRAPHICS = b"\x1b_Gi=31,s=1,v=1,a=q,t=d,f=24;AAAA\x1b\\"
_CELL_SIZE, _WINDOW_SIZE = b"\x1b[16t", b"\x1b[14t"
_QUESTIONS = b"\x1b[>0q" + _CELL_SIZE + _WINDOW_SIZE + b"\x1b[?2026$p\x1b[?1016$p\x1b[?u"
_SENTINEL = b"\x1b[c"

_ANSWERS = {
    "XTVERSION": re.compile(rb"\x1bP>\|([^\x1b]*)\x1b\\"),
    "DA1": re.compile(rb"\x1b\[\?([\d;]*)c"),
    "cell 16t": re.compile(rb"\x1b\[6;(\d+;\d+)t"),
    "window 14t": re.compile(rb"\x1b\[4;(\d+;\d+)t"),
    "mode 2026": re.compile(rb"\x1b\[\?2026;(\d+)\$y"),
    "mode 1016": re.compile(rb"\x1b\[\?1016;(\d+)\$y"),
    "kitty keyboard": re.compile(rb"\x1b\[\?(\d+)u"),
    "kitty graphics": re.compile(rb"\x1b_Gi=31;([^\x1b]*)\x1b\\"),
}
_BAD_KITTY_GRAPHICS = ("iterm2", "wezterm")
"""They answer OK, but what they draw is wrong in places; their sixel is right."""

_TRUECOLOR_PROGRAMS: tuple[str, ...] = ("kitty", "foot", "wezterm", "ghostty", "iterm", "konsole", "contour")
_TRUECOLOR_PROGRAMS += ("mlterm", "xterm.js", "xterm(", "alacritty", "rio", "vte", "vscode", "windows", "tmux")
_TRUECOLOR_TERMS = ("-direct", "kitty", "alacritty", "foot", "ghostty", "wezterm", "contour", "mlterm")
_OWN_VARIABLES = {
    "KONSOLE_VERSION": "Konsole",
    "VTE_VERSION": "VTE",
    "MLTERM": "mlterm",
    "WT_SESSION": "Windows Terminal",
}


@dataclass(frozen=True, slots=True)
class Profile:
    """What a terminal can do.

    Attributes
    ----------
    program, version : str
        What the terminal calls itself, or what the environment says; "" where nothing does.
    colors : int
        16777216 for 24-bit colour, else 256.
    kitty_graphics, sixel : bool
        Pictures it draws.
    synchronized : bool
        Whether an update can be held back until it is complete (mode 2026).
    kitty_keyboard : bool
        Whether keys report repeats and releases.
    pixel_mouse : bool
        Whether the mouse reports pixels (mode 1016).
    cell_size : tuple of 2 ints, or None
        Width and height of a text cell in pixels, from CSI 16t.
    window_size : tuple of 2 ints, or None
        Width and height of the text area in pixels, from CSI 14t.
    replies : mapping of str to str
        The answers by the name of the question, readable; for the HUD.
    """

    program: str = ""
    version: str = ""
    colors: int = 256
    kitty_graphics: bool = False
    sixel: bool = False
    synchronized: bool = False
    kitty_keyboard: bool = False
    pixel_mouse: bool = False
    cell_size: tuple[int, int] | None = None
    window_size: tuple[int, int] | None = None
    replies: Mapping[str, str] = field(default_factory=dict)


def questions(environment: Mapping[str, str]) -> bytes:
    """Return what to ask a terminal, in one write; the last question is one that every terminal answers."""
    term = environment.get("TERM", "")
    if term in ("", "dumb", "linux"):
        return _SENTINEL
    # Terminal.app prints this question; tmux and screen take it for a title.
    private = _multiplexed(environment) or environment.get("TERM_PROGRAM") == "Apple_Terminal"
    return _QUESTIONS + (b"" if private else _GRAPHICS) + _SENTINEL


def answered(replies: bytes) -> bool:
    """Return whether the answer to the last question is there."""
    return _ANSWERS["DA1"].search(replies) is not None


def patience(environment: Mapping[str, str]) -> float:
    """Return how many seconds to wait for the answers."""
    remote = environment.get("SSH_CONNECTION") or environment.get("SSH_TTY")
    return REMOTE_TIMEOUT if remote else TIMEOUT


def size_questions(profile: Profile) -> bytes:
    """Return what to ask again when the size changed: with another font, a cell has another size."""
    return (_CELL_SIZE if profile.cell_size else b"") + (_WINDOW_SIZE if profile.window_size else b"")


def detect(environment: Mapping[str, str], replies: bytes) -> Profile:
    """Return what a terminal can do.

    Parameters
    ----------
    environment : mapping of str to str
        Environment variables; believed only where the terminal says nothing, for they leak through
        tmux, screen and SSH.
    replies : bytes
        What the terminal answered to `questions`, with anything in between.
    """
    said = {
        name: match[1].decode("ascii", "replace")
        for name, pattern in _ANSWERS.items()
        if (match := pattern.search(replies))
    }
    program, version = _program(environment, said.get("XTVERSION", ""))
    attributes = said.get("DA1", "").split(";")[1:]
    drawn = said.get("kitty graphics") == "OK" and program.lower() not in _BAD_KITTY_GRAPHICS
    return Profile(
        program=program,
        version=version,
        colors=1 << 24 if _truecolor(environment, said.get("XTVERSION") or program) else 256,
        kitty_graphics=drawn and not _multiplexed(environment),
        sixel="4" in attributes,
        synchronized=said.get("mode 2026") in ("1", "2"),
        kitty_keyboard="kitty keyboard" in said,
        pixel_mouse=said.get("mode 1016") in ("1", "2"),
        cell_size=_pair(said.get("cell 16t")),
        window_size=_pair(said.get("window 14t")),
        replies=said,
    )


def outputs(profile: Profile) -> tuple[str, ...]:
    """Return the encoders this terminal can show, best first; never empty."""
    pictures = ("kitty",) * profile.kitty_graphics + ("sixel",) * profile.sixel
    return (*pictures, "half", "half256") if profile.colors > 256 else (*pictures, "half256")


def choose_output(requested: str | None, environment: Mapping[str, str], profile: Profile) -> str:
    """Return the encoder to use: ``requested``, else TSPLAT_OUTPUT, else the best one.

    Raises
    ------
    OptionError
        ``requested`` or TSPLAT_OUTPUT names no encoder. One that the terminal did not announce is allowed.
    """
    for source, name in (("output", requested), ("TSPLAT_OUTPUT", environment.get("TSPLAT_OUTPUT"))):
        if name and name not in OUTPUTS:
            raise OptionError(f"{source} must be one of {', '.join(OUTPUTS)}, got {name!r}")
        if name:
            return name
    return outputs(profile)[0]


def _multiplexed(environment: Mapping[str, str]) -> bool:
    term = environment.get("TERM", "")
    return bool(environment.get("TMUX") or environment.get("STY")) or term.startswith(("tmux", "screen"))


def _program(environment: Mapping[str, str], xtversion: str) -> tuple[str, str]:
    if match := re.fullmatch(r"([^( ]+)[( ]?([^)]*)\)?", xtversion):
        return match[1], match[2]
    term = environment.get("TERM", "")
    if name := next((name for name in ("alacritty", "kitty", "foot", "ghostty", "mlterm") if name in term), None):
        return name, ""
    if name := environment.get("TERM_PROGRAM"):
        return name, environment.get("TERM_PROGRAM_VERSION", "")
    for variable, name in _OWN_VARIABLES.items():
        if variable in environment:
            return name, environment[variable] if variable.endswith("VERSION") else ""
    return term, ""


def _truecolor(environment: Mapping[str, str], program: str) -> bool:
    if environment.get("STY"):
        return False  # COLORTERM leaks into screen, and screen 4 garbles 24-bit colour
    if environment.get("COLORTERM", "") in ("truecolor", "24bit"):
        return True
    if any(part in environment.get("TERM", "") for part in _TRUECOLOR_TERMS):
        return True
    return program.lower().startswith(_TRUECOLOR_PROGRAMS)


def _pair(reply: str | None) -> tuple[int, int] | None:
    """Return width and height from "height;width", None unless both are positive."""
    height, width = map(int, (reply or "0;0").split(";"))
    return (width, height) if width > 0 and height > 0 else None
