"""What is turned on for a session, each with what turns it off again.

By hand rather than with blessed: its `mouse_enabled()` and `synchronized_output()` do nothing where the
terminal does not answer DECRQM (tmux, alacritty, konsole, mosh), although the modes work there.
"""

from __future__ import annotations

from tsplat.terminal.probe import Profile

SCREEN = (b"\x1b[?1049h\x1b[?25l", b"\x1b[0m\x1b[?25h\x1b[?1049l")
"""The alternate screen, without a cursor. Leaving it brings the shell's screen back: nothing may follow."""

UNFINISHED = b"\x1b\\\x1b[?2026l\x1b[0m"
"""Ends what a write that was interrupted may have begun: a picture, a synchronized update, a colour."""

Mode = tuple[bytes, bytes]


def modes(profile: Profile) -> list[Mode]:
    """Return what to turn on after `SCREEN`, in order, with what turns it off."""
    chosen = [
        (b"\x1b[?7l", b"\x1b[?7h"),  # no autowrap: a picture that reaches the last column moves nothing
        (b"\x1b[?1002h\x1b[?1006h", b"\x1b[?1006l\x1b[?1002l"),  # buttons, drags and wheel, in decimal
        (b"\x1b[?1004h", b"\x1b[?1004l"),  # focus
        (b"\x1b[?2004h", b"\x1b[?2004l"),  # what is pasted comes in brackets, and is not taken for keys
    ]
    if reports_pixels(profile):
        chosen.append((b"\x1b[?1016h", b"\x1b[?1016l"))
    if profile.in_band_resize:
        chosen.append((b"\x1b[?2048h", b"\x1b[?2048l"))
    if profile.kitty_keyboard:
        # All keys as numbers, with releases and the text they type: then what comes up is what went down.
        chosen.append((b"\x1b[>31u", b"\x1b[<u"))
    if profile.kitty_graphics and not profile.multiplexer:
        chosen.append((b"", b"\x1b_Ga=d,d=A,q=2\x1b\\"))
    return chosen


def turn_on(profile: Profile, before: Profile | None = None) -> bytes:
    """Return what turns on all modes but the screen, and those that are on with ``before``.

    Turned on a second time, the screen would forget the shell's cursor, and the kitty keyboard would need
    to be turned off twice.
    """
    already = modes(before) if before else []
    return b"".join(mode[0] for mode in modes(profile) if mode not in already)


def turn_off(profile: Profile) -> bytes:
    """Return what turns off all modes, in reverse order, the screen last."""
    return b"".join(off for _, off in reversed([SCREEN, *modes(profile)]))


def reports_pixels(profile: Profile) -> bool:
    """Return whether the mouse is asked for pixels: only where a cell's size is known can they be cells again."""
    return profile.pixel_mouse and profile.cell_size is not None
