"""Moving pictures: frames that are drawn when their turn comes, to an animated GIF or WebP, or a video.

Frames are asked for one at a time and not kept, so that a long recording needs no more memory than a short one;
only GIF, whose writer sees all before it writes any, keeps a byte for each pixel that moved.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, Protocol

import numpy as np
import numpy.typing as npt

from tsplat.errors import OptionError, SaveError

if TYPE_CHECKING:
    from PIL import Image

U8 = npt.NDArray[np.uint8]
Progress = Callable[[float], None]

SUFFIXES = (".gif", ".webp", ".mp4")

GIF_FPS = 50
"""GIF counts in hundredths of a second, and browsers take a single one for a tenth."""

GIF_COLORS = 255
"""One less than a GIF has: the last one says that a pixel has not changed."""

PALETTE_FRAMES, PALETTE_SIDE, PALETTE_REFINEMENTS = 12, 320, 2
"""The palette is made of this many frames, this many pixels across, moved to the means of its clusters so often:
3 dB better on the demo than one from median cut alone."""

WEBP_QUALITY = 80
BEFORE = -1
"""Where a picture of many frames stands before its first one."""

CRF = "18"
"""How much x264 may lose: what can hardly be seen."""


class Frames(Protocol):
    """A sequence of frames of one size, each drawn when it is asked for."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int, /) -> U8:
        """Return a frame, uint8 [H, W, 3]."""


def check(path: str | Path, fps: int, width: int, height: int) -> str:
    """Return the lower-case suffix of ``path``.

    Raises
    ------
    SaveError
        It names no format, or one whose library is not installed.
    OptionError
        The format cannot hold frames of this size, or so many a second.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise SaveError(f"{path}: suffix '{suffix}' is no moving picture; use one of {', '.join(SUFFIXES)}")
    if suffix == ".mp4" and find_spec("av") is None:
        raise SaveError(f"{path}: video needs PyAV: pip install 'tsplat[video]'")
    if suffix == ".mp4" and (width % 2 or height % 2):
        raise OptionError(f"the sides of a video must be even, got {width} x {height}")
    if suffix == ".gif" and fps > GIF_FPS:
        raise OptionError(f"a GIF shows at most {GIF_FPS} frames a second, got {fps}")
    return suffix


def write(file: BinaryIO, suffix: str, frames: Frames, fps: int, progress: Progress = lambda _: None) -> None:
    """Write frames that are shown one after another, over and over where the format can say so.

    Parameters
    ----------
    file : binary file
        Open for writing, on disk, empty.
    suffix : {".gif", ".webp", ".mp4"}
        The format: 255 colours chosen for the whole, without dithering, which moves and costs room;
        WebP of quality 80; or H.264 in yuv420p that starts to play before all of it is there.
    frames : sequence of uint8 [H, W, 3]
        At least one, all of one size. Some of them are asked for twice.
    fps : int
        Frames a second, 1 or more.
    progress : callable, optional
        Told the fraction that is done.

    Raises
    ------
    SaveError
        The video's encoder gave up.
    """
    if suffix == ".gif":
        _write_gif(file, frames, fps, progress)
    elif suffix == ".webp":
        _write_webp(file, frames, fps, progress)
    else:
        _write_mp4(file, frames, fps, progress)


def _write_gif(file: BinaryIO, frames: Frames, fps: int, progress: Progress) -> None:
    from PIL import Image

    palette = _palette(frames)

    def indexed(frame: U8) -> Image.Image:
        return Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)

    first, *shown = _durations(len(frames), fps, 10)
    rest = (indexed(frame) for frame in _followed(frames, progress, 1))
    indexed(frames[0]).save(
        file, "GIF", save_all=True, append_images=rest, duration=[first, *shown], loop=0, optimize=True
    )


def _palette(frames: Frames) -> Image.Image:
    """Return a picture whose palette suits all frames: then only what moved differs between two of them."""
    from PIL import Image

    chosen = range(0, len(frames), -(-len(frames) // PALETTE_FRAMES))
    step = max(1, frames[0].shape[1] // PALETTE_SIDE)
    samples = np.concatenate([frames[index][::step, ::step] for index in chosen])
    return Image.fromarray(samples).quantize(
        GIF_COLORS, method=Image.Quantize.MEDIANCUT, kmeans=PALETTE_REFINEMENTS
    )


def _write_webp(file: BinaryIO, frames: Frames, fps: int, progress: Progress) -> None:
    from PIL import Image

    class Reel(Image.Image):
        """All frames as one picture of many, which is how Pillow asks for them one at a time."""

        n_frames = len(frames)

        def tell(self) -> int:
            return BEFORE

        def seek(self, frame: int) -> None:
            if frame != BEFORE:  # where Pillow goes back to in the end
                self.im = Image.fromarray(frames[frame]).im
                progress((frame + 1) / len(frames))

    first = Image.fromarray(frames[0])
    if len(frames) == 1:
        return first.save(file, "WEBP", quality=WEBP_QUALITY)
    reel = Reel()
    reel.im, reel._mode, reel._size = first.im, first.mode, first.size
    durations = _durations(len(frames), fps, 1)
    return reel.save(file, "WEBP", save_all=True, duration=durations, loop=0, quality=WEBP_QUALITY, method=4)


def _write_mp4(file: BinaryIO, frames: Frames, fps: int, progress: Progress) -> None:
    import av
    from av.video.reformatter import Colorspace

    height, width = frames[0].shape[:2]
    try:
        # By name, as libav reads what it wrote again to bring the index to the front.
        with av.open(f"file:{file.name}", "w", format="mp4", options={"movflags": "+faststart"}) as container:
            stream = container.add_stream("libx264", rate=fps, options={"crf": CRF})
            stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
            # Players guess the matrix from the size where the file does not say.
            stream.codec_context.colorspace = Colorspace.ITU709
            for frame in _followed(frames, progress):
                pixels = av.VideoFrame.from_ndarray(frame, format="rgb24")
                container.mux(stream.encode(pixels.reformat(format="yuv420p", dst_colorspace=Colorspace.ITU709)))
            container.mux(stream.encode())
    except av.FFmpegError as error:
        raise SaveError(f"the video cannot be written: {error.strerror or error}") from error


def _followed(frames: Frames, progress: Progress, start: int = 0) -> Iterable[U8]:
    for index in range(start, len(frames)):
        yield frames[index]
        progress((index + 1) / len(frames))


def _durations(count: int, fps: int, unit: int) -> list[int]:
    """Return milliseconds for each frame, whole units that never drift away from the frames' true times."""
    ends = [round(1000 * index / (fps * unit)) * unit for index in range(count + 1)]
    return [end - start for start, end in pairwise(ends)]
