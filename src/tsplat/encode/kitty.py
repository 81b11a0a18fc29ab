"""Kitty graphics: each frame under the text, the new one placed before the old one goes.

Source: the kitty graphics protocol, https://sw.kovidgoyal.net/kitty/graphics-protocol/.
"""

from __future__ import annotations

import binascii
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from tsplat.encode.placeholders import MARKS, placeholder_cells
from tsplat.encode.png import palette_png, png
from tsplat.encode.protocol import FALLBACK_CELL, U8, EncodedFrame
from tsplat.encode.resample import check
from tsplat.errors import OptionError

if TYPE_CHECKING:
    from tsplat.encode.adaptive_palette import AdaptivePalette
    from tsplat.encode.handover import Handover

TRANSPORTS = ("shared", "file", "direct")
"""How frames can reach the terminal, fastest first; only "direct" leaves the machine."""

CHUNK = 4096
"""Most base64 bytes in one escape sequence, from the protocol."""

BELOW_TEXT = -1073741825
"""Depth of the picture: the first that lies also under text with a background, so a HUD is plain text."""

_IDS = (0x747370, 0x747371)
"""Pictures are sent under these two in turn: sending one again under its old id takes it off the screen first."""

_PLACEHOLDER_IDS = (0x74, 0x73)
"""The same where the id is the colour of placeholder cells; see `placeholder_cells`."""


class Quality(NamedTuple):
    """What a fidelity means: bits of each channel, or at most so many colours and how far off they may be."""

    least_fidelity: float
    bits: int = 8
    colors: int = 0
    tolerance: int = 0


_QUALITIES = (
    Quality(1.0),
    Quality(0.9, bits=7),
    Quality(0.7, bits=6),
    Quality(0.5, bits=5),
    Quality(0.3, colors=256),
    Quality(0.1, colors=128, tolerance=14),
    Quality(-math.inf, colors=64, tolerance=20),
)
"""Best first. Each takes about four fifths of the bytes of the one before it."""


class Kitty:
    """Encode frames as pictures of the kitty graphics protocol.

    Parameters
    ----------
    transport : {"direct", "shared", "file"}
        As PNG files between the escape sequences, as raw pixels in shared memory, or in temporary files. The last
        two need the terminal on this machine; where there is no room for them, "direct" takes over.
    tmux : bool
        Send commands through tmux, whose option ``allow-passthrough`` must be on, and draw cells of text that
        stand for the picture, at most 297 across and down: a larger picture is squeezed into these.

    Raises
    ------
    OptionError
        There is no such transport, or not on this system.
    """

    name = "kitty"
    divisible = True

    def __init__(self, transport: str = "direct", tmux: bool = False) -> None:
        if transport not in TRANSPORTS:
            raise OptionError(f"kitty's transport must be one of {', '.join(TRANSPORTS)}, got {transport!r}")
        self.fidelity = 1.0
        self._handover: Handover | None = None
        if transport != "direct":
            from tsplat.encode.handover import Handover  # temporary files and their randomness, 10 ms

            self._handover = Handover(transport)
        self._tmux = tmux
        self._ids = _PLACEHOLDER_IDS if tmux else _IDS
        self._shown: int | None = None
        self._before: int | None = None
        # One for each number of colours, so that a change of fidelity does not make a palette anew.
        self._palettes: dict[int, AdaptivePalette] = {}

    def pixels_per_cell(self, cell_width: int, cell_height: int) -> tuple[int, int]:
        """Return the size of the cell."""
        return (cell_width, cell_height) if cell_width and cell_height else FALLBACK_CELL

    def encode(self, frame: U8, columns: int, rows: int, cell_size: tuple[int, int]) -> EncodedFrame:  # noqa: ARG002
        """Draw a frame over text cells; see `Encoder.encode`. The terminal stretches it."""
        check(frame, columns, rows)
        old, new = self._shown, self._ids[self._shown == self._ids[0]]
        self._before, self._shown = old, new
        upload = self._upload(np.ascontiguousarray(frame), new)
        if self._tmux:
            columns, rows = min(columns, len(MARKS)), min(rows, len(MARKS))
            place = b"\x1b_Ga=p,U=1,i=%d,p=1,c=%d,r=%d,q=2\x1b\\" % (new, columns, rows)
            # The old picture stays until its id is used again: tmux may draw the cells later than this.
            return EncodedFrame(through_tmux(upload), through_tmux(place) + placeholder_cells(new, columns, rows))
        place = b"\x1b_Ga=p,i=%d,p=1,c=%d,r=%d,z=%d,C=1,q=2\x1b\\" % (new, columns, rows, BELOW_TEXT)
        return EncodedFrame(upload, place + (b"" if old is None else _delete(old)))

    def forget(self, cells: npt.NDArray[np.bool_] | None) -> None:
        """Do nothing: the picture lies under the text, and placeholder cells are all drawn each time."""

    def abandon(self) -> bytes:
        """Return what ends the upload and frees it; see `Encoder.abandon`."""
        sent, self._shown = self._shown, self._before
        end = b"\x1b_Gm=0,q=2;\x1b\\" + (b"" if sent is None else _delete(sent))
        return through_tmux(end) if self._tmux else end

    def clear(self) -> bytes:
        """Return what removes the pictures and frees their memory; take back those that nobody fetched."""
        self._shown = None
        if self._handover:
            self._handover.clear()
        deletions = b"".join(map(_delete, self._ids))
        return through_tmux(deletions) if self._tmux else deletions

    def _upload(self, frame: U8, identifier: int) -> bytes:
        if self._handover:
            medium, size = self._handover.medium, (*frame.shape[1::-1], frame.nbytes)
            try:
                name = binascii.b2a_base64(self._handover.leave(frame), newline=False)
                return b"\x1b_Ga=t,t=%b,f=24,s=%d,v=%d,S=%d,i=%d,q=2;%b\x1b\\" % (medium, *size, identifier, name)
            except OSError:
                self._handover.clear()
                self._handover = None
        return _chunks(self._picture(frame), identifier)

    def _picture(self, frame: U8) -> bytes:
        """Return a PNG file as good as the fidelity asks for."""
        quality = next(quality for quality in _QUALITIES if self.fidelity >= quality.least_fidelity)
        if not quality.colors:
            return png(round_to_bits(frame, quality.bits))
        from tsplat.encode.adaptive_palette import AdaptivePalette

        palette = self._palettes.setdefault(quality.colors, AdaptivePalette(quality.colors))
        palette.fit(frame)
        return palette_png(palette.indices(frame, tolerance=quality.tolerance), palette.colors[: quality.colors])


def round_to_bits(frame: U8, bits: int) -> U8:
    """Return a frame whose channels are multiples of ``2 ** (8 - bits)``, the nearest, and white stays white.

    Equal steps make the differences between rows few, which compresses better than spreading the levels.
    """
    if bits == 8:
        return frame
    step = 1 << (8 - bits)
    rounded = (frame + np.uint8(step // 2)) & np.uint8(256 - step)
    # Where that wrapped around to black, taking one away makes it white.
    np.subtract(rounded, frame >= 256 - step // 2, out=rounded, dtype=np.uint8, casting="unsafe")
    return rounded


def through_tmux(stream: bytes) -> bytes:
    """Wrap each graphics command of a stream so that tmux hands it to its terminal as it is."""
    # tmux halves pairs of escapes; its own string ends at the first that stands alone.
    doubled = stream.replace(b"\x1b", b"\x1b\x1b")
    return doubled.replace(b"\x1b\x1b_G", b"\x1bPtmux;\x1b\x1b_G").replace(b"\x1b\x1b\\", b"\x1b\x1b\\\x1b\\")


def _chunks(picture: bytes, identifier: int) -> bytes:
    text = binascii.b2a_base64(picture, newline=False)
    starts = range(0, len(text), CHUNK)
    keys = [b"q=2"] * len(starts)
    keys[0] = b"a=t,f=100,i=%d,q=2" % identifier
    return b"".join(
        b"\x1b_G%b,m=%d;%b\x1b\\" % (key, start + CHUNK < len(text), text[start : start + CHUNK])
        for key, start in zip(keys, starts, strict=True)
    )


def _delete(identifier: int) -> bytes:
    # A capital I frees the picture along with taking it off the screen.
    return b"\x1b_Ga=d,d=I,i=%d,q=2\x1b\\" % identifier
