from __future__ import annotations

import base64
import io
import re
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from tests.encode.frames import U8, frames, gradient, psnr, textured
from tsplat.encode.kitty import BELOW_TEXT, Kitty, round_to_bits
from tsplat.encode.png import palette_png

COMMAND = re.compile(rb"\x1b_G([^;\x1b]*)(?:;([^\x1b]*))?\x1b\\")


def commands(stream: bytes) -> list[tuple[dict[str, str], bytes]]:
    """Split a stream into graphics commands: keys and payload; nothing else may stand between."""
    found = list(COMMAND.finditer(stream))
    assert b"".join(match[0] for match in found) == stream
    return [(dict(pair.split("=") for pair in match[1].decode().split(",")), match[2] or b"") for match in found]


def shown(upload: bytes) -> Image.Image:
    payload = b"".join(payload for _, payload in commands(upload))
    return Image.open(io.BytesIO(base64.b64decode(payload, validate=True)))


@given(frames())
def test_the_payload_is_a_png_of_the_very_pixels(frame: U8) -> None:
    picture = shown(Kitty().encode(frame, 7, 5, (10, 20)).upload)
    assert picture.format == "PNG"
    assert np.array_equal(np.asarray(picture), frame)


def test_less_fidelity_takes_fewer_bytes_and_still_shows_the_picture() -> None:
    kitty, frame = Kitty(), textured(120, 72)
    sizes = []
    for kitty.fidelity, floor in ((1.0, 90), (0.9, 50), (0.8, 45), (0.6, 40), (0.4, 32), (0.2, 30), (0.0, 28)):
        upload = kitty.encode(frame, 12, 6, (10, 12)).upload
        assert psnr(np.asarray(shown(upload).convert("RGB")), frame) > floor
        sizes.append(len(upload))
    assert all(fewer < 0.95 * more for more, fewer in pairwise(sizes))


@given(frames(), st.integers(5, 7))
def test_channels_are_rounded_to_the_nearest_step_and_white_stays_white(frame: U8, bits: int) -> None:
    step, rounded = 1 << (8 - bits), round_to_bits(frame, bits)
    assert np.abs(frame.astype(int) - rounded).max() <= step // 2
    assert (rounded[rounded % step != 0] == 255).all()
    assert (rounded[frame == 255] == 255).all()
    assert (rounded[frame == 0] == 0).all()


@given(frames())
def test_a_palette_png_shows_each_pixel_in_its_colour(frame: U8) -> None:
    indices, colors = frame[..., 0], np.random.default_rng(5).integers(0, 256, (256, 3), dtype=np.uint8)
    picture = Image.open(io.BytesIO(palette_png(indices, colors)))
    assert picture.mode == "P"
    assert np.array_equal(np.asarray(picture.convert("RGB")), colors[indices])


def test_a_large_picture_comes_in_chunks_of_4096_marked_as_continued() -> None:
    noise = np.random.default_rng(1).integers(0, 256, (90, 100, 3), dtype=np.uint8)
    upload = commands(Kitty().encode(noise, 10, 5, (10, 20)).upload)
    assert len(upload) > 5
    assert [keys["m"] for keys, _ in upload] == ["1"] * (len(upload) - 1) + ["0"]
    assert [len(payload) for _, payload in upload[:-1]] == [4096] * (len(upload) - 1)
    assert 0 < len(upload[-1][1]) <= 4096
    assert upload[0][0].items() >= {"a": "t", "f": "100", "q": "2"}.items()
    assert all(set(keys) == {"q", "m"} for keys, _ in upload[1:])


def test_a_placement_covers_the_cells_below_the_text_and_leaves_the_cursor() -> None:
    (keys, payload), *others = commands(Kitty().encode(gradient(3, 3), 7, 5, (10, 20)).draw)
    assert (payload, others) == (b"", [])
    assert keys.items() >= {"a": "p", "c": "7", "r": "5", "C": "1", "q": "2", "z": str(BELOW_TEXT)}.items()
    assert int(keys["z"]) < -1073741824


def test_the_old_picture_goes_only_after_the_new_one_is_placed_and_under_another_id() -> None:
    kitty, shown = Kitty(), ""
    for _ in range(4):
        encoded = kitty.encode(gradient(3, 3), 2, 2, (10, 20))
        uploaded = commands(encoded.upload)[0][0]["i"]
        actions = [(keys["a"], keys["i"]) for keys, _ in commands(encoded.draw)]
        assert uploaded != shown
        assert actions == [("p", uploaded)] + ([("d", shown)] if shown else [])
        shown = uploaded


def test_clearing_frees_every_picture_that_was_sent() -> None:
    kitty = Kitty()
    sent = {commands(kitty.encode(gradient(3, 3), 2, 2, (10, 20)).upload)[0][0]["i"] for _ in range(3)}
    cleared = commands(kitty.clear())
    assert {keys["i"] for keys, _ in cleared} == sent
    assert {(keys["a"], keys["d"]) for keys, _ in cleared} == {("d", "I")}


def test_the_bytes_are_the_ones_looked_at(golden: Callable[[str, bytes], None]) -> None:
    kitty = Kitty()
    first, second = (kitty.encode(gradient(8, 6), 4, 2, (10, 20)) for _ in range(2))
    # The payload depends on the version of the compressor; a test of its own decodes it.
    uploads = [re.sub(rb";[^\x1b]+", b";PNG", encoded.upload) for encoded in (first, second)]
    golden("kitty.bin", uploads[0] + first.draw + uploads[1] + second.draw + kitty.clear())
