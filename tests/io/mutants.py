"""Damage that files suffer and liars do, from a seed."""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable, Iterator, Sequence
from random import Random

from tests.io.containers import opened

BYTES = (0, 1, 0x7F, 0x80, 0xFF)
NUMBERS = (0, 1, -1, 2**31 - 1, 2**31, 2**32 - 1, 2**53, 2**63 - 1)
"""What counts, sizes and offsets become."""

HALVES = tuple(struct.pack("<e", value) for value in (math.nan, math.inf, -1.0))
FLOATS = HALVES + tuple(
    struct.pack(code, value)
    for code in ("<f", ">f", "<d")
    for value in (math.nan, math.inf, -1.0, -0.0, 1e-22, 1e25)
)
"""What floats become: no numbers, and some whose squares are none in float32."""

ESCAPES = (b"\x1b]0;name\x07\r\n", b"\\u001b[2J\\n")
"""What must not reach a terminal, as it is and as JSON has it."""

WORDS = (b"0", b"-1", b"2147483647", b"4294967295", b"18446744073709551616", b"1e308", b"-1e-320", b"NaN", b"null")
"""What a number in text becomes."""

TEXT_NUMBER = re.compile(rb"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?")
JSON_COUNT = re.compile(rb'"(\w*(?i:count|shape|length|offset|stride|file|bands|levels|version))": ?\[?(\d+)')
TEXT_BYTES = 4096
"""How far numbers in text are looked for: headers of binary files are no longer."""

LIES = (b"0", b"60000000", b"2147483647", b"4294967295", b'"\\u001b[2J"')
"""What counts in text become: some that a format allows, but few bytes do not, and no number at all."""

HEAD_CHARS, TEXT_COUNTS = 64, 8
"""Where a head is text, and how many numbers may be counts where no names tell."""

HEAD_BYTES, COUNTS = 5120, 24
"""The same of a binary one: that of a .ksplat is the longest."""

Mutation = Callable[[Random, bytes, Sequence[bytes]], bytes]


def mutant(random: Random, raw: bytes, others: Sequence[bytes] = (), change: Mutation | None = None) -> bytes:
    """Return a file with one to three faults, in its bytes or in what is packed inside of them.

    Parameters
    ----------
    random : Random
        Decides everything.
    raw : bytes
        The file.
    others : sequence of bytes
        Files that it may be spliced with.
    change : callable, optional
        What makes a fault; by default one of `MUTATIONS`.
    """
    inside = opened(raw) if random.random() < 0.8 else None
    if inside and inside.parts:
        parts = list(inside.parts)
        which = random.randrange(len(parts))
        parts[which] = mutant(random, parts[which], inside.parts, change)
        return inside.pack(parts)
    for _ in range(random.choice((1, 1, 2, 3))):
        raw = (change or random.choice(MUTATIONS))(random, raw, others)
    return raw


def liars(raw: bytes) -> Iterator[bytes]:
    """Yield a file with one number of its head after the other made larger than what is there, or nothing.

    Heads of containers lie in their first part.
    """
    inside = opened(raw)
    if inside and inside.parts:
        for lie in liars(inside.parts[0]):
            yield inside.pack([lie, *inside.parts[1:]])
    if raw[:HEAD_CHARS].isascii():
        for first, last in _counts(raw):
            for new in (raw[first:last] + b"000", b"1" + raw[first:last], *LIES):
                yield raw[:first] + new + raw[last:]
    else:
        places = [at for at in range(0, min(len(raw), HEAD_BYTES), 4) if any(raw[at : at + 4])]
        for at in places[:COUNTS]:
            found = int.from_bytes(raw[at : at + 4], "little")
            for number in (found + 1, found * 1000, 2**32 - 1):
                yield _replaced(raw, at, (number % 2**32).to_bytes(4, "little"))


def _counts(raw: bytes) -> list[tuple[int, int]]:
    """Return where the counts of a head in text begin and end."""
    if not raw.lstrip().startswith(b"{"):
        return [word.span() for word in TEXT_NUMBER.finditer(raw, 0, TEXT_BYTES)][:TEXT_COUNTS]
    spans: dict[bytes, list[tuple[int, int]]] = {}
    for found in JSON_COUNT.finditer(raw):
        spans.setdefault(found[1], []).append(found.span(2))
    return [span for each in spans.values() for span in each[:2]]


def _flip_bit(random: Random, raw: bytes, _: Sequence[bytes]) -> bytes:
    at = _place(random, raw)
    return _replaced(raw, at, bytes([raw[at] ^ 1 << random.randrange(8)])) if raw else raw


def _set_byte(random: Random, raw: bytes, _: Sequence[bytes]) -> bytes:
    return _replaced(raw, _place(random, raw), bytes([random.choice(BYTES)]))


def _set_number(random: Random, raw: bytes, _: Sequence[bytes]) -> bytes:
    size = random.choice((2, 4, 4, 8))
    at = _place(random, raw) // 2 * 2
    found = int.from_bytes(raw[at : at + size], "little")
    number = random.choice((found - 1, found + 1, found * 1000, *NUMBERS))
    return _replaced(raw, at, (number % 256**size).to_bytes(size, "little"))


def _set_float(random: Random, raw: bytes, _: Sequence[bytes]) -> bytes:
    return _replaced(raw, _place(random, raw) // 2 * 2, random.choice(FLOATS))


def _set_word(random: Random, raw: bytes, others: Sequence[bytes]) -> bytes:
    words = list(TEXT_NUMBER.finditer(raw, 0, TEXT_BYTES))
    if not words:
        return _set_number(random, raw, others)
    word = random.choice(words[:TEXT_COUNTS] if random.random() < 0.6 else words)  # counts come first
    new = random.choice(WORDS)
    if word.group().isdigit() and len(word.group()) < 20 and random.random() < 0.5:
        count = int(word.group())
        new = str(random.choice((count - 1, count + 1, 1000 * count))).encode()
    return raw[: word.start()] + new + raw[word.end() :]


def _cut(random: Random, raw: bytes, _: Sequence[bytes]) -> bytes:
    return raw[: random.randrange(len(raw) + 1)]


def _double(random: Random, raw: bytes, _: Sequence[bytes]) -> bytes:
    first, last = _span(random, raw)
    return raw[:last] + raw[first:]


def _delete(random: Random, raw: bytes, _: Sequence[bytes]) -> bytes:
    first, last = _span(random, raw)
    return raw[:first] + raw[last:]


def _insert(random: Random, raw: bytes, _: Sequence[bytes]) -> bytes:
    at, size = random.randrange(len(raw) + 1), random.choice((1, 4, 16, 300))
    block = random.choice((bytes(size), b"\xff" * size, random.randbytes(size), *ESCAPES))
    return raw[:at] + block + raw[at:]


def _splice(random: Random, raw: bytes, others: Sequence[bytes]) -> bytes:
    other = random.choice(others) if others else raw
    return raw[: random.randrange(len(raw) + 1)] + other[random.randrange(len(other) + 1) :]


MUTATIONS: tuple[Mutation, ...] = (
    *(_flip_bit, _set_byte, _set_number, _set_float, _set_word),
    *(_cut, _double, _delete, _insert, _splice),
)


def _place(random: Random, raw: bytes) -> int:
    # Most of some headers is padding that nobody reads, so bytes near others than zero come first.
    places = [random.randrange(len(raw)) for _ in range(8)] if raw else [0]
    solid = next((at for at in places if any(raw[at : at + 4])), places[0])
    return solid if random.random() < 0.7 else random.randrange(min(len(raw), 256) or 1)


def _span(random: Random, raw: bytes) -> tuple[int, int]:
    first = random.randrange(len(raw) + 1)
    size = random.choice((1, 4, 32, len(raw)))
    return first, min(len(raw), first + random.randrange(size + 1))


def _replaced(raw: bytes, at: int, new: bytes) -> bytes:
    # Never longer: a field at the end loses its last bytes.
    return raw[:at] + new[: len(raw) - at] + raw[at + len(new) :]
