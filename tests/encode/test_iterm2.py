from __future__ import annotations

import base64
import io
import re
from itertools import pairwise

import numpy as np
from hypothesis import given
from PIL import Image

from tests.encode.frames import U8, frames, gradient, psnr, textured
from tsplat.encode.iterm2 import ITerm2

SEQUENCE = re.compile(rb"\x1b7\x1b\]1337;File=([^:]*):([A-Za-z0-9+/=]*)\x07\x1b8")


def picture(stream: bytes) -> tuple[dict[bytes, bytes], Image.Image]:
    """Take the one sequence apart: its keys, and the file as Pillow reads it."""
    match = SEQUENCE.fullmatch(stream)
    assert match
    keys = dict(pair.split(b"=") for pair in match[1].split(b";"))
    file = base64.b64decode(match[2], validate=True)
    assert len(file) == int(keys[b"size"])
    return keys, Image.open(io.BytesIO(file))


@given(frames())
def test_a_frame_of_any_size_comes_as_a_jpeg_of_that_size(frame: U8) -> None:
    encoded = ITerm2().encode(frame, 7, 5, (10, 20))
    _, file = picture(encoded.draw)
    assert encoded.upload == b""
    assert (file.format, file.mode, file.size) == ("JPEG", "RGB", frame.shape[1::-1])


def test_the_picture_fills_its_cells_inline_and_the_cursor_stays() -> None:
    keys, _ = picture(ITerm2().encode(gradient(30, 20), 7, 5, (10, 20)).draw)
    wanted = {b"inline": b"1", b"width": b"7", b"height": b"5", b"preserveAspectRatio": b"0"}
    assert keys.items() >= wanted.items()
    assert keys[b"doNotMoveCursor"] == b"1"


def test_less_fidelity_takes_fewer_bytes_and_still_shows_the_picture() -> None:
    encoder, frame = ITerm2(), textured(160, 96)
    sizes = []
    for encoder.fidelity, floor in ((1.0, 33), (0.8, 32), (0.6, 31), (0.4, 31), (0.2, 31)):
        stream = encoder.encode(frame, 16, 6, (10, 16)).draw
        assert psnr(np.asarray(picture(stream)[1]), frame) > floor
        sizes.append(len(stream))
    assert all(fewer < 0.95 * more for more, fewer in pairwise(sizes))


def test_at_full_fidelity_colours_stay_in_their_pixels() -> None:
    stripes = np.zeros((16, 16, 3), np.uint8)
    stripes[:, ::2, 0] = stripes[:, 1::2, 2] = 200
    encoder = ITerm2()
    exact = np.asarray(picture(encoder.encode(stripes, 2, 1, (8, 16)).draw)[1])
    encoder.fidelity = 0.9
    mixed = np.asarray(picture(encoder.encode(stripes, 2, 1, (8, 16)).draw)[1])
    assert psnr(exact, stripes) > 30 > 15 > psnr(mixed, stripes)


def test_fidelity_beyond_its_ends_counts_as_the_end() -> None:
    encoder, frame = ITerm2(), gradient(40, 24)
    streams = []
    for encoder.fidelity in (1.0, 2.0, 0.0, -1.0):
        streams.append(encoder.encode(frame, 4, 1, (10, 24)).draw)
    assert streams[0] == streams[1] != streams[2] == streams[3]
