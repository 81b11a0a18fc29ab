from __future__ import annotations

import base64
import io
import re
from collections.abc import Callable

import numpy as np
from hypothesis import given
from PIL import Image

from tests.encode.frames import U8, frames, gradient
from tsplat.encode.kitty import BELOW_TEXT, Kitty

COMMAND = re.compile(rb"\x1b_G([^;\x1b]*)(?:;([^\x1b]*))?\x1b\\")


def commands(stream: bytes) -> list[tuple[dict[str, str], bytes]]:
    """Split a stream into graphics commands: keys and payload; nothing else may stand between."""
    found = list(COMMAND.finditer(stream))
    assert b"".join(match[0] for match in found) == stream
    return [(dict(pair.split("=") for pair in match[1].decode().split(",")), match[2] or b"") for match in found]


@given(frames())
def test_the_payload_is_a_png_of_the_very_pixels(frame: U8) -> None:
    upload = commands(Kitty().encode(frame, 7, 5, (10, 20)).upload)
    picture = Image.open(io.BytesIO(base64.b64decode(b"".join(payload for _, payload in upload), validate=True)))
    assert picture.format == "PNG"
    assert np.array_equal(np.asarray(picture), frame)


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
