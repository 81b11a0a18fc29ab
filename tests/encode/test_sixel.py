from __future__ import annotations

import io
import re
import shutil
import subprocess
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from tests.encode.frames import U8, frames, gradient, psnr, textured
from tsplat.encode.adaptive_palette import AdaptivePalette
from tsplat.encode.sixel import Sixel
from tsplat.errors import OptionError


def decode(stream: bytes) -> U8:
    """Decode with libsixel, which shares nothing with the encoder."""
    if shutil.which("sixel2png") is None:
        pytest.fail("sixel2png is missing: install the Debian package libsixel-bin (make test does)")
    start, end = stream.index(b"\x1bP"), stream.index(b"\x1b\\") + 2
    decoded = subprocess.run(["sixel2png"], input=stream[start:end], capture_output=True, check=True, timeout=20)
    return np.asarray(Image.open(io.BytesIO(decoded.stdout)).convert("RGB"))


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


def test_less_fidelity_takes_fewer_bytes_and_still_shows_the_picture() -> None:
    sixel, frame = Sixel(), textured(120, 72)
    sizes = []
    for sixel.fidelity, floor in ((1.0, 32), (0.8, 30), (0.6, 28), (0.4, 27), (0.2, 25)):
        stream = sixel.encode(frame, 12, 6, (10, 12)).draw
        assert psnr(decode(stream)[:72], frame) > floor
        sizes.append(len(stream))
    assert all(fewer < 0.95 * more for more, fewer in pairwise(sizes))


def test_half_way_down_there_are_at_most_64_colours_and_none_beyond_that() -> None:
    sixel = Sixel()
    sixel.fidelity = 0.5
    stream = sixel.encode(textured(80, 60), 8, 6, (10, 10)).draw
    assert 32 < len(set(re.findall(rb"#(\d+);2;", stream))) <= 64
    assert max(int(index) for index in re.findall(rb"#(\d+)", stream)) < 64


@settings(max_examples=40)
@given(frames(), st.integers(1, 60))
def test_within_a_tolerance_a_pixel_is_near_its_colour_or_has_the_nearest(frame: U8, tolerance: int) -> None:
    palette = AdaptivePalette(16)
    palette.fit(frame)
    lazily = palette.colors[palette.indices(frame, tolerance=tolerance)]
    near = ((frame.astype(int) - lazily) ** 2).sum(axis=2) <= tolerance**2
    assert (near | (lazily == palette.quantize(frame)).all(axis=2)).all()


def test_a_tolerance_makes_flat_what_differs_by_less() -> None:
    frame = np.random.default_rng(2).integers(100, 108, (24, 24, 3), dtype=np.uint8)
    palette = AdaptivePalette()
    palette.fit(frame)
    assert len(np.unique(palette.indices(frame))) > 4
    assert len(np.unique(palette.indices(frame, tolerance=16))) == 1


@pytest.mark.parametrize("fidelity", [1.0, 0.6, 0.2])
def test_a_background_keeps_its_colour_and_nothing_runs_into_it(fidelity: float) -> None:
    frame = textured(60, 36)
    frame[20:33] = np.random.default_rng(4).integers(0, 18, (13, 60, 3))
    frame[33:] = 0
    sixel = Sixel()
    sixel.fidelity = fidelity
    assert not decode(sixel.encode(frame, 6, 3, (10, 12)).draw)[33:36].any()


def test_dithering_brings_each_patch_closer_to_its_colour_on_average() -> None:
    def patches(frame: U8) -> npt.NDArray[np.float64]:
        means: npt.NDArray[np.float64] = frame.reshape(18, 4, 30, 4, 3).mean(axis=(1, 3))
        return means

    frame = gradient(120, 72)
    flat, dithered = (decode(Sixel(dither).encode(frame, 12, 6, (10, 12)).draw)[:72] for dither in (False, True))
    errors = [np.abs(patches(shown) - patches(frame)).mean() for shown in (flat, dithered)]
    assert errors[1] < 0.8 * errors[0]


def test_below_full_fidelity_nothing_is_dithered() -> None:
    plain, dithering = Sixel(), Sixel(dither=True)
    streams = []
    for sixel in (plain, dithering):
        sixel.fidelity = 0.5
        streams.append(sixel.encode(textured(40, 24), 4, 2, (10, 12)).draw)
    assert streams[0] == streams[1]


@given(st.integers(1, 400), st.integers(1, 100), st.integers(1, 1000), st.integers(6, 1000))
def test_the_pictures_of_a_frame_cover_it_once_and_none_is_larger_than_the_terminal_takes(
    columns: int, rows: int, most_width: int, most_height: int
) -> None:
    covered = np.zeros((rows, columns), int)
    for tile in Sixel(max_size=(most_width, most_height)).tiles(columns, rows, (10, 20)):
        covered[tile.row : tile.row + tile.rows, tile.column : tile.column + tile.columns] += 1
        assert tile.columns * 10 <= most_width or tile.columns == 1
        assert -(-tile.rows * 20 // 6) * 6 <= most_height or tile.rows == 1
    assert (covered == 1).all()


def test_a_picture_beyond_the_largest_size_is_drawn_as_several_that_lie_where_they_belong() -> None:
    frame = gradient(200, 120)
    stream = Sixel(max_size=(100, 90)).encode(frame, 20, 6, (10, 20)).draw
    parts = re.findall(rb"(?:\x1b\[(\d+)B)?(?:\x1b\[(\d+)C)?(\x1bP.*?\x1b\\)", stream, re.DOTALL)
    canvas = np.zeros((120, 200, 3), np.uint8)
    for down, right, picture in parts:
        ((width, height),) = (map(int, found) for found in re.findall(rb'"1;1;(\d+);(\d+)', picture))
        assert width <= 100
        assert -(-height // 6) * 6 <= 90
        top, left = 20 * int(down or 0), 10 * int(right or 0)
        canvas[top : top + height, left : left + width] = decode(picture)[:height]
    assert len(parts) == 4
    assert psnr(canvas, frame) > 30


def test_a_picture_within_the_largest_size_is_drawn_as_ever() -> None:
    frame = gradient(50, 36)
    limited, free = (Sixel(max_size=most).encode(frame, 5, 2, (10, 18)).draw for most in ((50, 36), None))
    assert limited == free


def test_a_largest_size_without_room_for_a_band_is_refused() -> None:
    with pytest.raises(OptionError, match="at least 1 x 6 pixels, got 100 x 5"):
        Sixel(max_size=(100, 5))


def test_the_cursor_returns_to_where_the_picture_began() -> None:
    stream = Sixel().encode(gradient(20, 20), 2, 1, (10, 20)).draw
    assert stream.startswith(b"\x1b7\x1bP")
    assert stream.endswith(b"\x1b\\\x1b8")


def test_the_bytes_are_the_ones_looked_at(golden: Callable[[str, bytes], None]) -> None:
    bars = np.repeat(np.array([[[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255]]], np.uint8), 5, axis=1)
    golden("sixel.bin", Sixel().encode(np.repeat(bars, 7, axis=0), 20, 7, (1, 1)).draw)
