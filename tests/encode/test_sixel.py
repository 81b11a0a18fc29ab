from __future__ import annotations

import io
import math
import re
import shutil
import subprocess
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from PIL import Image

from tests.encode.frames import U8, frames, gradient
from tsplat.encode.adaptive_palette import AdaptivePalette
from tsplat.encode.sixel import Sixel


def decode(stream: bytes) -> U8:
    """Decode with libsixel, which shares nothing with the encoder."""
    if shutil.which("sixel2png") is None:
        pytest.fail("sixel2png is missing: install the Debian package libsixel-bin (make test does)")
    start, end = stream.index(b"\x1bP"), stream.index(b"\x1b\\") + 2
    decoded = subprocess.run(["sixel2png"], input=stream[start:end], capture_output=True, check=True, timeout=20)
    return np.asarray(Image.open(io.BytesIO(decoded.stdout)).convert("RGB"))


def psnr(one: U8, other: U8) -> float:
    error = float(np.mean((one.astype(np.float64) - other) ** 2))
    return 10 * math.log10(255**2 / max(error, 1e-9))


def difference(one: U8, other: U8) -> int:
    return int(np.abs(one.astype(int) - other).max())


@settings(max_examples=40)
@given(frames())
def test_another_decoder_sees_each_pixel_in_its_colour_of_the_palette(frame: U8) -> None:
    palette = AdaptivePalette()
    palette.fit(frame)
    height, width = frame.shape[:2]
    decoded = decode(Sixel().encode(frame, width, height, (1, 1)).draw)
    assert decoded.shape[0] in (height, -(-height // 6) * 6)
    assert decoded.shape[1] == width
    # One level apart: terminals round percent to 8 bits in their own ways.
    assert difference(decoded[:height], palette.quantize(frame)) <= 1


def test_a_smooth_picture_keeps_its_colours() -> None:
    frame = gradient(200, 120)
    assert psnr(decode(Sixel().encode(frame, 20, 6, (10, 20)).draw)[:120], frame) > 30


def test_the_palette_takes_the_nearest_of_its_colours() -> None:
    palette = AdaptivePalette()
    frame = np.random.default_rng(3).integers(0, 256, (30, 40, 3), dtype=np.uint8)
    palette.fit(frame)
    centres = frame // 8 * 8 + 4
    distances = ((centres[:, :, None].astype(int) - palette.colors.astype(int)) ** 2).sum(axis=3)
    ours = ((centres.astype(int) - palette.quantize(frame)) ** 2).sum(axis=2)
    assert np.array_equal(ours, distances.min(axis=2))


def test_the_palette_stays_while_it_fits_and_changes_when_the_colours_do() -> None:
    sixel = Sixel()

    def registers(frame: U8) -> list[bytes]:
        return re.findall(rb"#\d+;2;\d+;\d+;\d+", sixel.encode(frame, 20, 6, (10, 20)).draw)

    frame = gradient(200, 120)
    before = registers(frame)
    nudged = np.roll(frame, 1, axis=1)
    assert registers(nudged) == before
    green = frame.copy()
    green[..., ::2] //= 8
    assert registers(green) != before
    assert psnr(decode(sixel.encode(green, 20, 6, (10, 20)).draw)[:120], green) > 35


def test_raster_attributes_say_the_size_in_pixels_and_the_frame_is_stretched_to_it() -> None:
    blocks = np.zeros((2, 2, 3), np.uint8)
    blocks[0, 0], blocks[1, 1] = (255, 0, 0), (0, 0, 255)
    stream = Sixel().encode(blocks, 3, 2, (8, 15)).draw
    assert re.search(rb'"1;1;24;30[#\d]', stream)
    stretched = blocks.repeat(15, axis=0).repeat(12, axis=1)
    assert difference(decode(stream)[:30], stretched) <= 8


def test_runs_longer_than_three_are_counted_and_shorter_ones_are_not() -> None:
    def body(columns: int) -> bytes:
        frame = np.full((6, columns, 3), 255, np.uint8)
        match = re.search(rb"#\d+;2;[\d;#]*?#\d+([!~\d]+)-\x1b", Sixel().encode(frame, columns, 6, (1, 1)).draw)
        assert match
        return match[1]

    assert [body(columns) for columns in (1, 3, 4, 5, 120)] == [b"~", b"~~~", b"!4~", b"!5~", b"!120~"]


def test_the_cursor_returns_to_where_the_picture_began() -> None:
    stream = Sixel().encode(gradient(20, 20), 2, 1, (10, 20)).draw
    assert stream.startswith(b"\x1b7\x1bP")
    assert stream.endswith(b"\x1b\\\x1b8")


def test_the_bytes_are_the_ones_looked_at(golden: Callable[[str, bytes], None]) -> None:
    bars = np.repeat(np.array([[[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255]]], np.uint8), 5, axis=1)
    golden("sixel.bin", Sixel().encode(np.repeat(bars, 7, axis=0), 20, 7, (1, 1)).draw)
