"""From the state to a frame: the right variant of the scene, the right camera, the colours asked for."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tsplat import images
from tsplat.camera import MAX_SIDE, Camera
from tsplat.drawing import draw_all
from tsplat.encode import FALLBACK_CELL, EncodedFrame, Encoder, encoder
from tsplat.encode.pieces import pieces
from tsplat.rendering import Rendering
from tsplat.scene import Gaussians
from tsplat.terminal.keys import TerminalSize
from tsplat.terminal.probe import TRUECOLOR, Profile
from tsplat.viewer.detail import Detail
from tsplat.viewer.scenes import OnDisk, Scenes
from tsplat.viewer.spans import Span, covered, painted, shaded
from tsplat.viewer.state import Loaded, ViewerState
from tsplat.warmup import draw_tiny
from tsplat.warmup_process import SIDE, encode_tiny

if TYPE_CHECKING:
    from tsplat.io.tsplat_map import Mapped

F32 = npt.NDArray[np.float32]
U8 = npt.NDArray[np.uint8]

HOME = b"\x1b[H"

TRUE_COLORS = Profile(colors=TRUECOLOR)

LUMA = np.array([0.2126, 0.7152, 0.0722], np.float32)
"""How bright each primary looks, ITU-R BT.709."""

MOST_PIXELS = 1 << 24
"""Of a frame, twice those of the largest common screen: each takes 20 bytes on its way to the terminal."""

SAVED_SIDE = 1920
"""Pixels of the longer side of a saved picture, or more where the screen has more."""


@dataclass(frozen=True, eq=False, slots=True)
class Drawn:
    """One frame before it is encoded.

    Attributes
    ----------
    frame : ndarray of uint8, [H, W, 3]
    visible : int
        Splats that touch the image.
    stage_ms : dict of str to float
        Milliseconds by stage.
    density : float
        Of the pixels that the state asks for, along either side.
    exact : bool
        Whether every splat was drawn.
    """

    frame: U8
    visible: int
    stage_ms: dict[str, float]
    density: float = 1.0
    exact: bool = True


class Painter:
    """Renders and encodes what the state shows; keeps the encoder, which knows what it left on screen."""

    def __init__(self, scenes: Scenes, profile: Profile = TRUE_COLORS, *, dither: bool = False) -> None:
        self.scenes, self.profile, self.dither = scenes, profile, dither
        self.detail = Detail(scenes.loaded)
        self.encoder: Encoder | None = None

    def warm_up(self, state: ViewerState) -> None:
        """Make the kernels ready that drawing and encoding this state needs; may run on any thread."""
        chosen = self.new_encoder(state)  # not the one that remembers what is on screen
        draw_tiny(replace(state.options, depths=False))
        self.detail.warm_up(view_camera(state, SIDE, SIDE))
        encode_tiny(chosen)

    def draw(self, state: ViewerState, density: float = 1.0, *, exact: bool = True) -> Drawn:
        """Render a frame of the size that the output needs, or a share of it along either side.

        Where it need not be ``exact``, splats may be merged.
        """
        sparse = replace(state, density=state.density * density)
        size = frame_size(sparse, self.choose(state))
        scene = self.scenes.variant(state.kept, state.raw_opacity)
        camera = view_camera(state, *size)
        # Asked for an exact frame as well: levels are best begun with the first.
        exact = not self.detail.helps(scene, camera) or (exact and self.detail.complete)
        if exact:
            rendering = self.render(state, *size)
        else:
            rendering = self.detail.draw(camera, replace(state.options, depths=False))
        frame = images.quantize(saturated(rendering.colors, state.saturation))
        return Drawn(frame, rendering.visible, rendering.stage_ms, density, exact)

    @property
    def file(self) -> Mapped | None:
        """The file that is drawn from while the viewer runs; None where all is in memory, or going to be."""
        return self.scenes.loaded.mapped if isinstance(self.scenes, OnDisk) else None

    def reload(self) -> Loaded:
        """Open the scene's file anew.

        Raises
        ------
        LoadError
            It cannot be read.
        """
        from tsplat.lod import open_stored

        assert self.file
        stored = open_stored(self.file.path)
        self.scenes, self.detail = OnDisk(stored), self.detail.of(stored)
        return Loaded(len(stored), stored.sh_degree)

    @property
    def read(self) -> float:
        """How much of the scene was read, in tenths; 1 where there is no more to come."""
        return math.floor(10.0 * self.detail.done) / 10.0 if self.detail.reading else 1.0

    def detail_status(self, drawn: Drawn) -> str:
        """Return what there is to say of the splats of a frame, often nothing."""
        return self.detail.status(drawn.exact)

    def encode(
        self, state: ViewerState, frame: U8, spans: Sequence[Span], fidelity: float = 1.0
    ) -> tuple[EncodedFrame, bytes]:
        """Return a frame as bytes, and the bytes that put text over it."""
        columns, rows = state.size.columns, picture_rows(state.size, state.output)
        chosen = self.choose(state)
        chosen.fidelity = fidelity
        encoded = chosen.encode(self._under_text(state, frame, spans), columns, rows, state.size.cell_size)
        chosen.forget(covered(spans, columns, rows))
        return encoded, painted(spans, backgrounds=state.output != "kitty")

    def pieces(self, state: ViewerState, frame: U8, spans: Sequence[Span], size: int) -> Iterator[bytes]:
        """Yield a frame in pieces of about ``size`` bytes; see `tsplat.encode.pieces`.

        Text over it comes with the last; where a piece covers text that is on screen, with each.
        """
        columns, rows = state.size.columns, picture_rows(state.size, state.output)
        chosen = self.choose(state)
        chosen.fidelity = 1.0
        whole = self._under_text(state, frame, spans)
        text = painted(spans, backgrounds=state.output != "kitty")
        start = HOME
        for piece in pieces(chosen, whole, columns, rows, state.size.cell_size, size):
            yield start + piece + (b"" if chosen.divisible else text)
            start = b"" if chosen.divisible else HOME
        if text:
            yield text
        chosen.forget(covered(spans, columns, rows))

    @property
    def divisible(self) -> bool:
        """Whether pieces of a frame are parts of one update, not updates of their own."""
        return self.encoder is not None and self.encoder.divisible

    def clear(self) -> bytes:
        """Return what removes the pictures left on screen, and free what they hold elsewhere."""
        return self.encoder.clear() if self.encoder else b""

    def abandon(self) -> bytes:
        """Return what ends the pieces sent so far, when the rest of them will not follow."""
        return self.encoder.abandon() if self.encoder else b""

    def _under_text(self, state: ViewerState, frame: U8, spans: Sequence[Span]) -> U8:
        """Return a frame, with the backgrounds of the text in it where terminals may blend them wrongly."""
        if state.output != "kitty" or not spans:
            return frame
        return shaded(frame, spans, state.size.columns, picture_rows(state.size, state.output))

    def choose(self, state: ViewerState) -> Encoder:
        """Return the encoder of the state's output."""
        if self.encoder is None or self.encoder.name != state.output:
            self.encoder = self.new_encoder(state)
        return self.encoder

    def new_encoder(self, state: ViewerState) -> Encoder:
        """Return an encoder of the state's output for this terminal."""
        profile = self.profile
        return encoder(
            state.output,
            profile.colors,
            profile.kitty_transports[0],
            tmux=profile.multiplexer == "tmux",
            sixel_size=profile.sixel_size,
            dither=self.dither,
        )

    def render(self, state: ViewerState, width: int, height: int) -> Rendering:
        """Render the state's view at a size in pixels."""
        scene = self.scenes.variant(state.kept, state.raw_opacity)
        rendering = draw_all(scene, view_camera(state, width, height), replace(state.options, depths=False))
        if not isinstance(scene, Gaussians):
            scene.let_go()  # all of it was read, and may be more than there is memory
        return rendering

    def save(self, state: ViewerState, path: Path) -> Path:
        """Save the view as a picture of at least 1920 pixels.

        Raises
        ------
        SaveError
            The folder cannot be written.
        """
        width, height = screen_pixels(state.size, state.output)
        enlarge = max(1.0, SAVED_SIDE / max(width, height))
        width, height = limited(round(width * enlarge), round(height * enlarge))
        rendering = self.render(state, width, height)
        return images.save(path, saturated(rendering.colors, state.saturation), rendering.alphas)


def picture_rows(size: TerminalSize, output: str) -> int:
    """Return the text rows that the picture covers; sixel in the last one would scroll the screen."""
    return max(1, size.rows - (output == "sixel"))


def screen_pixels(size: TerminalSize, output: str) -> tuple[int, int]:
    """Return width and height of the picture in screen pixels; their ratio is what a person sees."""
    cell_width, cell_height = size.cell_size if all(size.cell_size) else FALLBACK_CELL
    return size.columns * cell_width, picture_rows(size, output) * cell_height


def empty_cell(state: ViewerState) -> bytes:
    """Return the colours of cells without a picture: the scene's background below sixel, else the terminal's."""
    if state.output != "sixel":
        return b"\x1b[0m"
    red, green, blue = images.quantize(np.array(state.options.background, np.float32)).tolist()
    return b"\x1b[0;48;2;%d;%d;%dm" % (red, green, blue)


def frame_size(state: ViewerState, chosen: Encoder) -> tuple[int, int]:
    """Return width and height of the frame to render, in pixels."""
    across, down = chosen.pixels_per_cell(*state.size.cell_size)
    width = round(state.size.columns * across * state.density)
    height = round(picture_rows(state.size, state.output) * down * state.density)
    return limited(width, height)


def limited(width: int, height: int) -> tuple[int, int]:
    """Return a size of the same shape, no larger than frames may be; the encoder stretches what is smaller."""
    width, height = min(max(width, 1), MAX_SIDE), min(max(height, 1), MAX_SIDE)
    share = min(1.0, math.sqrt(MOST_PIXELS / (width * height)))
    return max(1, int(width * share)), max(1, int(height * share))


def view_camera(state: ViewerState, width: int, height: int) -> Camera:
    """Return the state's camera for a frame whose pixels need not be square on screen."""
    screen_width, screen_height = (min(side, MAX_SIDE) for side in screen_pixels(state.size, state.output))
    return state.pose.camera(screen_width, screen_height, state.fov_y).resized(width, height)


def saturated(colors: F32, saturation: float) -> F32:
    """Return colours moved away from their grey by a factor: 0 is grey, 1 changes nothing."""
    if saturation == 1.0:
        return colors
    grey = (colors @ LUMA)[..., None]
    moved: F32 = (grey + saturation * (colors - grey)).astype(np.float32, copy=False)
    return moved


def free_path(folder: Path, name: str) -> Path:
    """Return ``name-001.png`` in a folder, or the first number after it that no file has."""
    number = 1
    while (path := folder / f"{name}-{number:03d}.png").exists():
        number += 1
    return path
