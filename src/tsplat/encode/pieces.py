"""A frame sent a piece at a time, so that a slow link is free again soon when something more urgent comes."""

from __future__ import annotations

import re
from collections.abc import Iterator

from tsplat.encode.protocol import U8, Encoder

_BOUNDARY = re.compile(rb"(?<!\x1b)\x1b(?![\x1b\\])")
"""Where an escape sequence begins: neither the end of a string, nor an escape doubled within one."""


def pieces(
    encoder: Encoder, frame: U8, columns: int, rows: int, cell_size: tuple[int, int], size: int
) -> Iterator[bytes]:
    """Yield a frame in pieces; after the last one the screen shows it.

    Each but the first begins where the one before it left the cursor and the colours. When the rest shall not
    follow, write what ``encoder.abandon()`` returns.

    Parameters
    ----------
    frame, columns, rows, cell_size
        See `Encoder.encode`.
    size : int
        Bytes of a piece, about; never less than one escape sequence.
    """
    if not encoder.divisible:
        yield from _bands(encoder, frame, columns, rows, cell_size, size)
        return
    encoded = encoder.encode(frame, columns, rows, cell_size)
    yield from split(encoded.upload + encoded.draw, size)


def split(screen: bytes, size: int) -> Iterator[bytes]:
    """Yield the parts of a screen, of at most ``size`` bytes where escape sequences allow it."""
    start = end = 0
    for boundary in [*(match.start() for match in _BOUNDARY.finditer(screen)), len(screen)]:
        if boundary - start > size and end > start:
            yield screen[start:end]
            start = end
        end = boundary
    if end > start:
        yield screen[start:end]


def _bands(
    encoder: Encoder, frame: U8, columns: int, rows: int, cell_size: tuple[int, int], size: int
) -> Iterator[bytes]:
    """Yield bands of text rows, as high as their bytes allow: what is one escape sequence has no other pieces."""
    first, height = 0, rows
    while first < rows:
        last = min(first + height, rows)
        band = frame[len(frame) * first // rows : max(len(frame) * last // rows, len(frame) * first // rows + 1)]
        drawn = encoder.encode(band, columns, last - first, cell_size).draw
        if len(drawn) > size and last - first > 1:
            height = max(1, min((last - first) * size // len(drawn), last - first - 1))
            continue
        yield (b"\x1b[%dB" % first if first else b"") + drawn
        first = last
