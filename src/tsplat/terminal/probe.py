"""What this terminal can do: a pure function from the environment and the answers to a `Profile`.

Source of the terminals' ways: measured, or what their makers write; see tests/terminal/test_probe.py.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from tsplat.terminal.limits import LEAST_SIXEL, believed_cell
from tsplat.terminal.multiplexer import parsed_version, passes_pictures
from tsplat.terminal.questions import CELL_SIZE, TRANSPORTS, WINDOW_SIZE, is_remote, multiplexer, said

TRUECOLOR = 1 << 24

_BETTER_BY_ITERM2 = ("iterm", "wezterm")
"""They answer OK to kitty's question, but what they draw then is wrong in places; OSC 1337 is right."""
_ITERM2_PICTURES = (*_BETTER_BY_ITERM2, "mlterm")

_TRUECOLOR_PROGRAMS: tuple[str, ...] = ("kitty", "foot", "wezterm", "ghostty", "iterm", "konsole", "contour")
_TRUECOLOR_PROGRAMS += ("mlterm", "xterm.js", "xterm(", "alacritty", "rio", "vte", "vscode", "windows", "tmux")
_TRUECOLOR_TERMS = ("-direct", "kitty", "alacritty", "foot", "ghostty", "wezterm", "contour", "mlterm")
_SIXTEEN_COLOR_TERMS = re.compile(r"linux|ansi|vt\d+.*|.*-16color|screen(?!.*256).*")
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
    multiplexer : {"", "tmux", "screen", "zellij"}
        What is between this program and the terminal, and answers in its place.
    remote : bool
        Whether the terminal is on another machine, over SSH.
    colors : int
        16777216 for 24-bit colour, 256, 16, or 0 where a person wants none (NO_COLOR).
    kitty_graphics, iterm2_pictures, sixel : bool
        Pictures it draws, and draws right.
    sixel_size : tuple of 2 ints, or None
        Most pixels across and down of a sixel picture, from XTSMGRAPHICS.
    kitty_transports : tuple of {"shared", "file", "direct"}
        Ways to hand it a kitty picture, best first: those that were tried with success, and "direct".
    synchronized : bool
        Whether an update can be held back until it is complete (mode 2026).
    kitty_keyboard : bool
        Whether keys report repeats and releases.
    pixel_mouse : bool
        Whether the mouse reports pixels (mode 1016).
    in_band_resize : bool
        Whether a new size is reported like a key (mode 2048).
    cell_size : tuple of 2 ints, or None
        Width and height of a text cell in pixels, from CSI 16t.
    window_size : tuple of 2 ints, or None
        Width and height of the text area in pixels, from CSI 14t.
    replies : mapping of str to str
        The answers by the name of the question, readable; for the HUD.
    """

    program: str = ""
    version: str = ""
    multiplexer: str = ""
    remote: bool = False
    colors: int = 256
    kitty_graphics: bool = False
    iterm2_pictures: bool = False
    sixel: bool = False
    sixel_size: tuple[int, int] | None = None
    kitty_transports: tuple[str, ...] = ("direct",)
    synchronized: bool = False
    kitty_keyboard: bool = False
    pixel_mouse: bool = False
    in_band_resize: bool = False
    cell_size: tuple[int, int] | None = None
    window_size: tuple[int, int] | None = None
    replies: Mapping[str, str] = field(default_factory=dict)


SIZE_REPORTS = (6, 4)
"""What `PixelReport.kind` is of the answers to questions about a cell's size, and the window's."""


def size_questions(profile: Profile) -> dict[int, bytes]:
    """Return what to ask again when the size changed, by the kinds of the answers: a new font has other cells."""
    answered = (profile.cell_size, CELL_SIZE), (profile.window_size, WINDOW_SIZE)
    known = zip(SIZE_REPORTS, answered, strict=True)
    return {kind: question.asks for kind, (size, question) in known if size}


def detect(environment: Mapping[str, str], replies: bytes, tmux: str = "") -> Profile:
    """Return what a terminal can do.

    Parameters
    ----------
    environment : mapping of str to str
        Environment variables; believed only where the terminal says nothing, for they leak through
        tmux, screen and SSH, and from tmux into terminals started there.
    replies : bytes
        What the terminal answered to `questions`, with anything in between.
    tmux : str
        What `ask_tmux` returned.
    """
    answers = said(replies)
    named = answers.get("XTVERSION", "")
    between = _multiplexer(environment, named)
    program, version = _program(environment, named, between)
    known = program.lower()
    remote = is_remote(environment)
    graphics = answers.get("kitty graphics") == "OK" and not between and not known.startswith(_BETTER_BY_ITERM2)
    tried = [name for name in TRANSPORTS if graphics and not remote and answers.get(f"kitty {name}") == "OK"]
    return Profile(
        program=program,
        version=version,
        multiplexer=between,
        remote=remote,
        colors=_colors(environment, named or program, between),
        kitty_graphics=graphics or (between == "tmux" and passes_pictures(tmux)),
        iterm2_pictures=not between and known.startswith(_ITERM2_PICTURES),
        sixel="4" in answers.get("DA1", "").split(";")[1:],
        sixel_size=_sixel_size(answers.get("sixel size")),
        kitty_transports=(*tried, "direct"),
        synchronized=_has_mode(answers, 2026),
        kitty_keyboard="kitty keyboard" in answers,
        pixel_mouse=_has_mode(answers, 1016),
        in_band_resize=_has_mode(answers, 2048),
        cell_size=believed_cell(*(_pair(answers.get("cell 16t")) or (0, 0))),
        window_size=_pair(answers.get("window 14t")),
        replies=answers,
    )


def _multiplexer(environment: Mapping[str, str], named: str) -> str:
    """Return what is in between; a terminal that names itself is not, whatever leaked into the environment."""
    if named:
        return next((name for name in ("tmux", "screen", "zellij") if named.lower().startswith(name)), "")
    return multiplexer(environment)


def _program(environment: Mapping[str, str], named: str, between: str) -> tuple[str, str]:
    if any(parsed := parsed_version(named)):
        return parsed
    if between:
        return between, ""
    term = environment.get("TERM", "")
    if name := next((name for name in ("alacritty", "kitty", "foot", "ghostty", "mlterm") if name in term), None):
        return name, ""
    if name := environment.get("TERM_PROGRAM"):
        return name, environment.get("TERM_PROGRAM_VERSION", "")
    for variable, name in _OWN_VARIABLES.items():
        if variable in environment:
            return name, environment[variable] if variable.endswith("VERSION") else ""
    return term, ""


def _colors(environment: Mapping[str, str], program: str, between: str) -> int:
    if environment.get("NO_COLOR"):
        return 0
    term = environment.get("TERM", "")
    if _SIXTEEN_COLOR_TERMS.fullmatch(term) and between != "tmux":
        return 16
    if between == "screen":
        return 256  # COLORTERM leaks into screen, and screen 4 garbles 24-bit colour
    if environment.get("COLORTERM", "") in ("truecolor", "24bit"):
        return TRUECOLOR
    if any(part in term for part in _TRUECOLOR_TERMS) or program.lower().startswith(_TRUECOLOR_PROGRAMS):
        return TRUECOLOR
    return 256


def _has_mode(answers: Mapping[str, str], mode: int) -> bool:
    return answers.get(f"mode {mode}") in ("1", "2")  # set or reset; 0 is not known, 4 never set


def _pair(reply: str | None) -> tuple[int, int] | None:
    """Return width and height from "height;width", None unless both are positive."""
    height, width = map(int, (reply or "0;0").split(";"))
    return (width, height) if width > 0 and height > 0 else None


def _sixel_size(reply: str | None) -> tuple[int, int] | None:
    """Return width and height from "width;height", None where no picture is that small."""
    width, height = map(int, (reply or "0;0").split(";"))
    return (width, height) if min(width, height) >= LEAST_SIXEL else None
