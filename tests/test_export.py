"""Moving pictures, read back by Pillow and by libav."""

from __future__ import annotations

import shutil
import weakref
from pathlib import Path

import av
import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

from tsplat import export
from tsplat.errors import OptionError, SaveError
from tsplat.files import replacing

U8 = npt.NDArray[np.uint8]

FLOORS = {".gif": 33.0, ".webp": 29.0, ".mp4": 29.0}
"""PSNR in dB that what is read back reaches at least: small, and of half the colours' resolution where not GIF.
A frame against its neighbour has under 25."""


def a_frame(index: int, width: int = 64, height: int = 48) -> U8:
    """Return a disc that moves to the right over a still, smooth background."""
    y, x = np.mgrid[0:height, 0:width]
    frame = np.stack([40 + x, 60 + 2 * y, 200 - x - y], axis=2).astype(np.float64)
    inside = np.clip(10.0 - np.hypot(x - 12 - 3 * index, y - height / 2), 0.0, 1.0)[..., None]
    blended: U8 = (frame * (1.0 - inside) + inside * np.array([250.0, 180.0, 60.0])).astype(np.uint8)
    return blended


def psnr(one: U8, other: U8) -> float:
    return float(10.0 * np.log10(255.0**2 / np.mean((one.astype(float) - other) ** 2)))


def written(folder: Path, suffix: str, frames: export.Frames, fps: int = 20) -> Path:
    path = folder / f"moving{suffix}"
    with replacing(path) as file:
        export.write(file, suffix, frames, fps)
    return path


def read(path: Path) -> tuple[list[U8], float]:
    """Return the frames of a file, and the seconds they are shown for in all."""
    if path.suffix == ".mp4":
        with av.open(str(path)) as container:
            (stream,) = container.streams.video
            decoded = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
            assert stream.duration is not None
            assert stream.time_base is not None
            return [np.asarray(frame, np.uint8) for frame in decoded], float(stream.duration * stream.time_base)
    frames: list[U8] = []
    milliseconds = 0
    with Image.open(path) as picture:
        for index in range(getattr(picture, "n_frames", 1)):
            picture.seek(index)
            frames.append(np.asarray(picture.convert("RGB")))
            milliseconds += picture.info["duration"]
    return frames, milliseconds / 1000


@pytest.mark.parametrize("suffix", export.SUFFIXES)
def test_what_is_read_back_is_what_was_drawn(tmp_path: Path, suffix: str) -> None:
    drawn = [a_frame(index) for index in range(12)]
    frames, seconds = read(written(tmp_path, suffix, drawn))
    assert seconds == pytest.approx(12 / 20)
    assert len(frames) == 12
    for frame, expected in zip(frames, drawn, strict=True):
        assert frame.shape == expected.shape
        assert psnr(frame, expected) > FLOORS[suffix]
    assert psnr(drawn[0], drawn[1]) < 25.0


@pytest.mark.parametrize("suffix", export.SUFFIXES)
@pytest.mark.parametrize("fps", [1, 24, 30])
def test_time_does_not_drift_where_a_format_counts_in_whole_units(tmp_path: Path, suffix: str, fps: int) -> None:
    _, seconds = read(written(tmp_path, suffix, [a_frame(index) for index in range(15)], fps))
    assert seconds == pytest.approx(15 / fps, abs=0.0051)


@pytest.mark.parametrize("suffix", export.SUFFIXES)
def test_a_picture_that_stands_still_is_shown_as_long(tmp_path: Path, suffix: str) -> None:
    frames, seconds = read(written(tmp_path, suffix, [a_frame(0)] * 9 + [a_frame(9)]))
    assert seconds == pytest.approx(0.5)
    assert psnr(frames[-1], a_frame(9)) > FLOORS[suffix]


@pytest.mark.parametrize("suffix", export.SUFFIXES)
def test_a_single_frame_is_a_picture(tmp_path: Path, suffix: str) -> None:
    path = written(tmp_path, suffix, [a_frame(4)])
    if suffix == ".webp":
        with Image.open(path) as picture:
            frame = np.asarray(picture.convert("RGB"))
    else:
        (frame,), _ = read(path)
    assert psnr(frame, a_frame(4)) > FLOORS[suffix]


@pytest.mark.parametrize("suffix", [".gif", ".webp"])
def test_it_is_shown_over_and_over(tmp_path: Path, suffix: str) -> None:
    with Image.open(written(tmp_path, suffix, [a_frame(0), a_frame(1)])) as picture:
        assert picture.info["loop"] == 0


def test_what_stands_still_in_a_gif_keeps_its_colours(tmp_path: Path) -> None:
    frames, _ = read(written(tmp_path, ".gif", [a_frame(index) for index in range(12)]))
    above = [frame[:10] for frame in frames]
    assert all(np.array_equal(strip, above[0]) for strip in above)
    assert len(np.unique(above[0].reshape(-1, 3), axis=0)) > 20


def test_a_video_can_start_before_all_of_it_is_there(tmp_path: Path) -> None:
    path = written(tmp_path, ".mp4", [a_frame(index) for index in range(5)])
    content = path.read_bytes()
    assert content.index(b"moov") < content.index(b"mdat")
    with av.open(str(path)) as container:
        (stream,) = container.streams.video
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")


def test_colours_of_a_video_are_those_that_were_drawn(tmp_path: Path) -> None:
    bars = np.repeat(np.array([[[220, 30, 30], [30, 200, 40], [40, 60, 230]]], np.uint8), 32, axis=1)
    frames, _ = read(written(tmp_path, ".mp4", [np.repeat(bars, 64, axis=0)] * 3))
    for middle, color in zip((16, 48, 80), bars[0, ::32], strict=True):
        assert np.abs(frames[0][32, middle].astype(int) - color).max() <= 4


@pytest.mark.parametrize("suffix", [".webp", ".mp4"])
def test_frames_are_drawn_one_at_a_time_and_not_kept(tmp_path: Path, suffix: str) -> None:
    class Watched:
        def __init__(self) -> None:
            self.drawn: list[weakref.ref[U8]] = []
            self.most = 0

        def __len__(self) -> int:
            return 30

        def __getitem__(self, index: int) -> U8:
            frame = a_frame(index)
            self.most = max(self.most, 1 + sum(each() is not None for each in self.drawn))
            self.drawn.append(weakref.ref(frame))
            return frame

    frames = Watched()
    written(tmp_path, suffix, frames)
    assert len(frames.drawn) >= 30
    assert frames.most <= 4


@pytest.mark.parametrize("suffix", export.SUFFIXES)
def test_progress_grows_to_one(tmp_path: Path, suffix: str) -> None:
    told: list[float] = []
    with (tmp_path / "x").open("wb") as file:
        export.write(file, suffix, [a_frame(index) for index in range(6)], 20, told.append)
    assert told == sorted(told)
    assert told[-1] == 1.0
    assert len(told) >= 5


@pytest.mark.parametrize("name", ["x.avi", "x", "x.png"])
def test_another_suffix_is_no_moving_picture(name: str) -> None:
    with pytest.raises(SaveError, match=r"use one of \.gif, \.webp, \.mp4"):
        export.check(name, 20, 64, 48)


def test_a_suffix_may_be_written_in_capitals() -> None:
    assert export.check("X.WebP", 20, 64, 48) == ".webp"


@pytest.mark.parametrize("size", [(63, 48), (64, 47)])
def test_a_video_of_odd_sides_is_refused(size: tuple[int, int]) -> None:
    with pytest.raises(OptionError, match="must be even, got"):
        export.check("x.mp4", 20, *size)
    assert export.check("x.gif", 20, *size) == ".gif"


def test_a_gif_of_more_frames_than_it_can_show_is_refused() -> None:
    assert export.check("x.gif", 50, 64, 48) == ".gif"
    with pytest.raises(OptionError, match="at most 50 frames a second, got 60"):
        export.check("x.gif", 60, 64, 48)


def test_without_the_video_library_the_message_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(export, "find_spec", lambda _: None)
    with pytest.raises(SaveError, match=r"pip install 'tsplat\[video\]'"):
        export.check("x.mp4", 20, 64, 48)
    assert export.check("x.webp", 20, 64, 48) == ".webp"


def test_a_video_that_cannot_be_written_is_a_save_error(tmp_path: Path) -> None:
    folder = tmp_path / "gone"
    folder.mkdir()
    with (folder / "x").open("wb") as file:
        shutil.rmtree(folder)
        with pytest.raises(SaveError, match="the video cannot be written: No such file"):
            export.write(file, ".mp4", [a_frame(0)], 20)


@pytest.mark.parametrize("name", ["a:b.mp4", "http:x.mp4", "%d 100%.mp4", "ä ö.mp4"])
def test_a_video_may_have_any_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.chdir(tmp_path)
    with replacing(Path(name)) as file:
        export.write(file, ".mp4", [a_frame(0)], 20)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert b"moov" in (tmp_path / name).read_bytes()
