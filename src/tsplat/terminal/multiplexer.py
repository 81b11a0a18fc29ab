"""What tmux says about the terminal around it: tmux answers the other questions for itself."""

from __future__ import annotations

import re
from collections.abc import Mapping

_SECONDS = 0.1
"""How long tmux may take; it answers within 10 ms, and hangs where its server does."""

_MOST_BYTES = 1 << 10
"""Of what tmux says; it has from the terminal what that calls itself."""

_FORMAT = "#{allow-passthrough}|#{client_termtype}"
_DRAW_PLACEHOLDERS = {"kitty": (0, 28), "ghostty": (1,)}
"""Terminals, and since when, that draw a picture where text says so: tmux moves text only."""


def ask_tmux(environment: Mapping[str, str]) -> str:
    """Return whether tmux lets pictures through, and to which terminal, as it says it; "" without tmux."""
    if not environment.get("TMUX"):
        return ""
    import subprocess  # 10 ms that nobody else should wait for

    try:
        asked = subprocess.run(
            ["tmux", "display-message", "-p", _FORMAT],
            env=dict(environment),
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=_SECONDS,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return asked.stdout[:_MOST_BYTES].decode(errors="replace").strip()


def passes_pictures(tmux: str) -> bool:
    """Return whether pictures in the kitty protocol get through tmux and are drawn, as `ask_tmux` has it."""
    allowed, _, terminal = tmux.partition("|")
    name, version = parsed_version(terminal)
    least = _DRAW_PLACEHOLDERS.get(name.lower())
    return allowed in ("1", "2", "on", "all") and least is not None and version_numbers(version) >= least


def parsed_version(text: str) -> tuple[str, str]:
    """Return name and version of "kitty(0.26.5)" or "Konsole 22.12.3", two "" where it is neither."""
    match = re.fullmatch(r"([^( ]+)[( ]?([^)]*)\)?", text.strip())
    return (match[1], match[2]) if match else ("", "")


def version_numbers(version: str) -> tuple[int, ...]:
    """Return the numbers a version begins with, fit to compare: "0.26.5" is (0, 26, 5)."""
    match = re.match(r"[0-9]{1,9}(?:\.[0-9]{1,9}){0,9}", version)
    return tuple(map(int, match[0].split("."))) if match else ()
