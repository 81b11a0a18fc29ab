"""What an SPZ says beside its splats: records of a type, a length and as many bytes.

Source: extensions/README.md of github.com/nianticlabs/spz. Before version 4 some writers left the length out.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from tsplat.io.options import SPZ_FRAMES

COORDINATE_SYSTEM = 0xADBE0003
"""The number of the axes, from 1; 0 says nothing."""

LENGTHS = {0xADBE0001: 2, 0xADBE0002: 12, COORDINATE_SYSTEM: 4}
"""Of the records that are known: how coarse harmonics were rounded, how far a viewer's camera may go, the axes.
The first two change no splat."""

SHOWN = 3
"""So many unknown records are named one by one."""

_WORD = struct.Struct("<I")


class Records(NamedTuple):
    """What records say.

    Attributes
    ----------
    frame : str, optional
        The axes, one of `tsplat.io.options.SPZ_FRAMES`, where they are said.
    problems : list of str
        Of what is not known here, and may matter.
    """

    frame: str | None
    problems: list[str]


def parse_records(content: bytes) -> Records:
    """Return what the bytes of records say; what they are not understood to say is a problem, but no error."""
    frame, problems, unknown = None, list[str](), list[str]()
    place = 0
    while len(content) - place >= _WORD.size:
        kind, start, length = _next(content, place)
        place = start + length
        if place > len(content):
            problems.append(
                f"a record of type {kind:#010x} goes on behind the {len(content)} bytes of all records"
            )
        elif kind and kind not in LENGTHS:  # 0 is no type: zeros fill up
            unknown.append(f"{kind:#010x} ({length} bytes)")
        elif kind == COORDINATE_SYSTEM and (number := _WORD.unpack_from(content, start)[0]):
            if number <= len(SPZ_FRAMES):
                frame = SPZ_FRAMES[number - 1]
            else:
                problems.append(f"its record of axes says {number}, expected 1 to {len(SPZ_FRAMES)}")
    if unknown:
        more = f" and {len(unknown) - SHOWN} more" if len(unknown) > SHOWN else ""
        problems.append(
            f"records of type {', '.join(unknown[:SHOWN])}{more} are not known here, and were not read"
        )
    return Records(frame, problems)


def _next(content: bytes, place: int) -> tuple[int, int, int]:
    """Return the type of a record, where what it says begins, and how many bytes that has."""
    (kind,) = _WORD.unpack_from(content, place)
    start, known = place + _WORD.size, LENGTHS.get(kind)
    said = _WORD.unpack_from(content, start)[0] if len(content) - start >= _WORD.size else None
    if said == known or (known is None and said is not None):
        return kind, start + _WORD.size, said if said is not None else 0
    return kind, start, known or 0
