"""Kitty graphics: each frame a PNG under the text, the new one placed before the old one goes.

Source: the kitty graphics protocol, https://sw.kovidgoyal.net/kitty/graphics-protocol/.
"""

from __future__ import annotations

import binascii
import struct

import numpy as np

from tsplat.encode.protocol import FALLBACK_CELL, U8, EncodedFrame
from tsplat.encode.resample import check

CHUNK = 4096
"""Most base64 bytes in one escape sequence, from the protocol."""

BELOW_TEXT = -1073741825
"""Depth of the picture: the first that lies also under text with a background, so a HUD is plain text."""

_IDS = (0x747370, 0x747371)
"""Pictures are sent under these two in turn: sending one again under its old id takes it off the screen first."""


class Kitty:
    """Encode frames as pictures of the kitty graphics protocol."""

    name = "kitty"

    def __init__(self) -> None:
        self._shown: int | None = None
        self._before: int | None = None
        self.fidelity = 1.0

    divisible = True

    def forget(self, cells: object) -> None:
        pass

    def abandon(self) -> bytes:
        """End a picture that was sent in part; the one before it is still on screen."""
        sent, self._shown = self._shown, self._before
        return b"\x1b_Gm=0,q=2;\x1b\\" + (b"" if sent is None else _delete(sent))

    def pixels_per_cell(self, cell_width: int, cell_height: int) -> tuple[int, int]:
        """Return the size of the cell."""
        return (cell_width, cell_height) if cell_width and cell_height else FALLBACK_CELL

    def encode(self, frame: U8, columns: int, rows: int, cell_size: tuple[int, int]) -> EncodedFrame:  # noqa: ARG002
        """Draw a frame over text cells; see `Encoder.encode`. The terminal stretches it."""
        check(frame, columns, rows)
        old, new = self._shown, _IDS[self._shown == _IDS[0]]
        self._before, self._shown = old, new
        place = b"\x1b_Ga=p,i=%d,p=1,c=%d,r=%d,z=%d,C=1,q=2\x1b\\" % (new, columns, rows, BELOW_TEXT)
        return EncodedFrame(_upload(png(frame), new), place + (b"" if old is None else _delete(old)))

    def clear(self) -> bytes:
        """Return what removes the pictures and frees their memory."""
        self._shown = None
        return b"".join(map(_delete, _IDS))


def png(frame: U8) -> bytes:
    """Return a frame as a PNG file: the Up filter everywhere, then the fastest deflate.

    Pillow tries all filters on each row and takes seven times as long for the same size.

    Parameters
    ----------
    frame : ndarray of uint8, [H, W, 3]
    """
    from isal import isal_zlib

    height, width = frame.shape[:2]
    rows = np.empty((height, 1 + 3 * width), np.uint8)
    rows[:, 0] = 2
    rows[0, 1:] = frame[0].ravel()
    np.subtract(frame[1:], frame[:-1], out=rows[1:, 1:].reshape(height - 1, width, 3))
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    pixels = isal_zlib.compress(rows.data, 1)
    chunks = ((b"IHDR", header), (b"IDAT", pixels), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(_png_chunk(kind, content) for kind, content in chunks)


def _png_chunk(kind: bytes, content: bytes) -> bytes:
    from isal import isal_zlib

    checksum = isal_zlib.crc32(content, isal_zlib.crc32(kind))
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", checksum)


def _upload(picture: bytes, identifier: int) -> bytes:
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
