"""Which encoders suit a terminal, best first, and why."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from tsplat.errors import OptionError
from tsplat.terminal.multiplexer import version_numbers
from tsplat.terminal.probe import TRUECOLOR, Profile

OUTPUTS = ("kitty", "iterm2", "sixel", "octant", "sextant", "quadrant", "half", "half256", "braille", "ascii")
"""Names of all encoders, best picture first; `tsplat.encode.ENCODERS` has the same."""

PICTURES = OUTPUTS[:3]

_FINE_WITHOUT_COLOR = ("octant", "braille", "sextant", "quadrant", "half", "ascii", "half256")
"""Without colour, a cell shows as many shades as it has parts."""

_OCTANTS: dict[str, tuple[int, ...]] = {"ghostty": (), "wezterm": (), "kitty": (0, 40)}
_SEXTANTS: dict[str, tuple[int, ...]] = {"foot": (), "xterm.js": (), "contour": (), "kitty": ()}
"""Terminals that draw these characters themselves, and since when: few fonts have them."""


_BETTER_WITH_SIXEL = ("mlterm", "xterm.js")
"""mlterm announces nothing else itself; xterm.js hides kitty pictures below its text where it draws with WebGL."""


@dataclass(frozen=True, slots=True)
class Offer:
    """Whether an encoder is offered, and why, in a few words."""

    name: str
    offered: bool
    why: str


def offers(profile: Profile) -> tuple[Offer, ...]:
    """Return all encoders, best first for this terminal, whether they are offered or not."""
    order: tuple[str, ...] = OUTPUTS
    if profile.colors == 0:
        order = (*PICTURES, *_FINE_WITHOUT_COLOR)
    elif profile.program.lower() in _BETTER_WITH_SIXEL:
        order = ("sixel", "kitty", "iterm2", *OUTPUTS[3:])
    return tuple(Offer(name, *_judged(name, profile)) for name in order)


def outputs(profile: Profile) -> tuple[str, ...]:
    """Return the encoders this terminal can show, best first; never empty."""
    return tuple(offer.name for offer in offers(profile) if offer.offered)


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


def _judged(name: str, profile: Profile) -> tuple[bool, str]:
    if name in PICTURES and profile.colors == 0:
        return False, "NO_COLOR is set"
    return _JUDGES[name](profile) if name in _JUDGES else (True, "nearly every font has its characters")


def _kitty(profile: Profile) -> tuple[bool, str]:
    if profile.multiplexer == "tmux":
        why = "tmux lets pictures through, and the terminal around it draws them where text says so"
        return profile.kitty_graphics, why if profile.kitty_graphics else "tmux passes it on to no terminal known"
    if profile.kitty_graphics:
        return True, f"the question was answered OK; ways that work: {', '.join(profile.kitty_transports)}"
    if profile.replies.get("kitty graphics") == "OK":
        return False, f"{profile.program} answers OK, but draws it wrong in places"
    return False, "the question was not answered OK"


def _iterm2(profile: Profile) -> tuple[bool, str]:
    known = profile.iterm2_pictures
    return known, f"{profile.program} draws it" if known else "known only of iTerm2, WezTerm and mlterm"


def _sixel(profile: Profile) -> tuple[bool, str]:
    return profile.sixel, "DA1 names attribute 4" if profile.sixel else "DA1 names no attribute 4"


def _drawn_by(known: Mapping[str, tuple[int, ...]]) -> Callable[[Profile], tuple[bool, str]]:
    def judge(profile: Profile) -> tuple[bool, str]:
        least = known.get(profile.program.lower())
        drawn = least is not None and version_numbers(profile.version) >= least
        return (
            drawn,
            f"{profile.program} draws its characters itself" if drawn else "few fonts have its characters",
        )

    return judge


def _quadrant(profile: Profile) -> tuple[bool, str]:
    # The Linux console's font has 256 characters: half blocks, but neither quadrants nor braille.
    console = profile.program == "linux"
    return (
        not console,
        "the console's font lacks its characters" if console else "nearly every font has its characters",
    )


def _half(profile: Profile) -> tuple[bool, str]:
    few = profile.colors == 256
    return not few, "half256 is the same in 256 colours" if few else "nearly every font has its characters"


def _half256(profile: Profile) -> tuple[bool, str]:
    few = profile.colors == 256
    more = "24-bit colour is there" if profile.colors == TRUECOLOR else "there are not that many colours"
    return few, "the terminal is not known to have 24-bit colour" if few else more


_JUDGES: dict[str, Callable[[Profile], tuple[bool, str]]] = {
    "kitty": _kitty,
    "iterm2": _iterm2,
    "sixel": _sixel,
    "octant": _drawn_by(_OCTANTS),
    "sextant": _drawn_by(_OCTANTS | _SEXTANTS),
    "quadrant": _quadrant,
    "half": _half,
    "half256": _half256,
    "braille": _quadrant,
}
