"""Front door: `encoder(name)` turns frames, uint8 [H, W, 3], into bytes for a terminal.

Knows nothing about Gaussians, cameras or the tty.
"""

from __future__ import annotations

from tsplat.encode.protocol import FALLBACK_CELL, EncodedFrame, Encoder
from tsplat.errors import OptionError

__all__ = ["ENCODERS", "FALLBACK_CELL", "PICTURES", "EncodedFrame", "Encoder", "encoder"]

ENCODERS: tuple[str, ...] = (
    "kitty", "iterm2", "sixel", "octant", "sextant", "quadrant", "half", "half256", "braille", "ascii",
)  # fmt: skip
"""Names of the encoders, best picture first."""

PICTURES = ENCODERS[:3]
"""Those that are no text."""


def encoder(
    name: str,
    colors: int = 1 << 24,
    transport: str = "direct",
    *,
    tmux: bool = False,
    sixel_size: tuple[int, int] | None = None,
    dither: bool = False,
) -> Encoder:
    """Return a new encoder.

    Parameters
    ----------
    name : str
        One of `ENCODERS`: kitty graphics, iTerm2 pictures, sixel graphics, or text cells of 2x4, 2x3, 2x2 or 1x2
        pixels (half256 has at most 256 colours), of dots, or of ASCII by brightness.
    colors : {16777216, 256, 16, 0}
        How many colours text may have; pictures have as many as they need.
    transport : {"direct", "shared", "file"}
        How kitty graphics reach a terminal; only "direct" leaves this machine.
    tmux : bool
        Whether kitty graphics have to pass through tmux.
    sixel_size : tuple of 2 ints, optional
        Most pixels across and down of one sixel picture.
    dither : bool
        Whether sixel mixes colours that its palette lacks.

    Raises
    ------
    OptionError
        There is no encoder of this name, or no such number of colours.
    """
    if name not in ENCODERS:
        raise OptionError(f"output must be one of {', '.join(ENCODERS)}, got {name!r}")
    if name == "kitty":
        from tsplat.encode.kitty import Kitty  # isal

        return Kitty(transport, tmux)
    if name == "iterm2":
        from tsplat.encode.iterm2 import ITerm2

        return ITerm2()
    if name == "sixel":
        from tsplat.encode.sixel import Sixel

        return Sixel(dither, sixel_size)
    from tsplat.encode.cells import Cells

    return Cells(name, colors)
