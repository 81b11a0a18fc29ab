"""The viewer in a terminal, next to what the library says it must show."""

from __future__ import annotations

import json
import math
import os
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from tests.e2e.display import U8
from tests.e2e.terminals import RECIPES, Terminal, clean_environment
from tsplat.framing import start_pose
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians
from tsplat.terminal import Key, Resize, TerminalSize
from tsplat.viewer.picture import Painter, screen_pixels
from tsplat.viewer.scenes import SceneVariants
from tsplat.viewer.state import Tick, ViewerState
from tsplat.viewer.update import update

PATIENCE = 40.0
"""Seconds until a screen that does not come is given up."""

REST = 0.6
"""Seconds without a change after which a screen is taken to rest; a slow frame takes a sixth of it."""

TAPS = 4
"""How often a key is tapped again."""

BACKGROUND = "#305070"
"""Of no terminal: a screen without a picture cannot be taken for one with an empty view."""

OPTIONS = RenderOptions(depths=False, background=(0x30 / 255, 0x50 / 255, 0x70 / 255))
TURN = (Key("right", "press"), Key("right", "release"), Tick(1.0))
"""What one tap of the right arrow is, once its motion has ended."""


@dataclass(frozen=True, slots=True)
class Case:
    """A terminal, an output, and how alike the screen and the rendered frame are at least.

    Attributes
    ----------
    terminal : str
        A name in `RECIPES`.
    output : str
        A name in `tsplat.encode.ENCODERS`.
    floor : float
        PSNR in dB; infinite where every pixel is the same.
    """

    terminal: str
    output: str
    floor: float

    def __str__(self) -> str:
        return f"{self.terminal}-{self.output}"


class Visit:
    """Start a terminal with the viewer in it, ready to begin.

    Parameters
    ----------
    case : Case
        Which terminal, which output.
    scene : Path
        The scene's file.
    gaussians : Gaussians
        The same scene, loaded.
    folder : Path
        An empty folder.

    Attributes
    ----------
    before : ndarray of uint8, [H, W, 3]
        The screen that the shell left.
    state : ViewerState
        What the viewer shows if it does as it should.
    """

    def __init__(self, case: Case, scene: Path, gaussians: Gaussians, folder: Path) -> None:
        self.case, self._folder = case, folder
        self._painter = Painter(SceneVariants(gaussians))
        self._painter.warm_up(_start(gaussians, TerminalSize(80, 24, 10, 20), case.output))
        home = folder / "home"
        home.mkdir(mode=0o700)
        program = [sys.executable, str(Path(__file__).with_name("inside.py")), str(folder)]
        program += [sys.executable, "-m", "tsplat", "view", str(scene), "--output", case.output]
        program += ["--background", BACKGROUND, "--antialias", "classic"]
        self.terminal: Terminal = RECIPES[case.terminal].start(home, _at_home(program), clean_environment())
        try:
            size = TerminalSize(*json.loads(self.file("size")))
            self.before = self.at_rest()
        except BaseException:
            self.terminal.close()
            raise
        self.state = _start(gaussians, size, case.output)

    def begin(self) -> None:
        """Start the viewer."""
        (self._folder / "go").touch()

    def file(self, name: str) -> str:
        """Return what a file says that the program inside writes, as soon as it is there."""
        path = self._folder / name
        self.until(path.exists, f"file '{name}'")
        return path.read_text()

    def resized(self) -> None:
        """Have the terminal made smaller."""
        before = self.file("size")
        self.terminal.resize()
        self.until(lambda: self.file("size") != before, "new size")
        self.state = update(self.state, Resize(TerminalSize(*json.loads(self.file("size")))))

    def turned(self) -> None:
        """Tap the right arrow, until the screen shows what one tap does.

        A terminal that reports releases may do so late when the machine is busy, and then the tap is a
        longer one: back to the start view, and once more.
        """
        start = self.state
        for event in TURN:
            self.state = update(self.state, event)
        turned = self.state
        for _ in range(TAPS):
            self.terminal.tap("Right")
            if self.likeness(self.at_rest()) >= self.case.floor:
                return
            self.state = start
            self.terminal.tap("z")
            self.until_alike()
            self.state = turned
        self.terminal.tap("Right")
        self.until_alike()

    def home(self) -> None:
        """Go back to the start view."""
        self.terminal.tap("z")
        self.state = update(self.state, Key("z"))

    def signal(self, number: signal.Signals) -> None:
        """Send the viewer a signal."""
        os.kill(int(self.file("pid")), number)

    def likeness(self, screen: U8) -> float:
        """Return how alike a screen and the frame are that the state stands for: PSNR in dB."""
        return psnr(*compared(screen, self._painter.draw(self.state).frame, self.state.size))

    def until_alike(self) -> None:
        """Wait for the screen that the state stands for."""
        frame = self._painter.draw(self.state).frame
        best = -math.inf

        def alike() -> bool:
            nonlocal best
            best = psnr(*compared(self.terminal.screen(), frame, self.state.size))
            return best >= self.case.floor

        self.until(alike, f"screen within {self.case.floor} dB of the frame", lambda: f"{best:.1f} dB")

    def at_rest(self) -> U8:
        """Return the screen once it does not change any more."""
        last, since = self.terminal.screen(), time.monotonic()

        def rests() -> bool:
            nonlocal last, since
            screen = self.terminal.screen()
            if not np.array_equal(screen, last):
                last, since = screen, time.monotonic()
            return time.monotonic() - since > REST

        self.until(rests, "rest")
        return last

    def until(self, met: Callable[[], bool], what: str, instead: Callable[[], str] = str) -> None:
        """Wait until something is so; else fail, with a picture of the screen beside the test's files."""
        end = time.monotonic() + PATIENCE
        while not met():
            if time.monotonic() > end:
                path = self._folder / "screen.png"
                Image.fromarray(self.terminal.screen()).save(path)
                raise AssertionError(f"no {what} in {PATIENCE:.0f} s {instead()}; see {path}")
            time.sleep(0.02)


def _start(gaussians: Gaussians, size: TerminalSize, output: str) -> ViewerState:
    width, height = screen_pixels(size, output)
    pose = start_pose(gaussians, aspect=width / height, fov_y=55.0, up=None)
    return ViewerState(
        pose=pose,
        start=pose,
        radius=0.5 * pose.distance,
        size=size,
        options=OPTIONS,
        output=output,
        outputs=(output,),
        total=len(gaussians),
        kept=len(gaussians),
        scene_degree=gaussians.sh_degree,
        releases=True,
    )


def compared(screen: U8, frame: U8, size: TerminalSize) -> tuple[U8, U8]:
    """Return what of a screen and of a frame must be the same: all but two rows of cells at the top and bottom.

    There are the badge and the message, whose letters reach into the next row. A frame of half blocks is
    looked for in the middle of each half of a cell; at its edges, letters may be smoothed.
    """
    across, down = size.cell_size
    if frame.shape[1] == size.columns:
        rows = ((2 * np.arange(len(frame)) + 1) * down) // 4
        columns = ((2 * np.arange(size.columns) + 1) * across) // 2
        return screen[np.ix_(rows[4:-4], columns)], frame[4:-4]
    if len(frame) < size.rows * down // 2:
        # Other shapes of cells have two colours for several pixels: the mean over each of these is compared.
        grid = Image.fromarray(screen[: size.rows * down, : size.columns * across])
        shown = np.asarray(grid.resize(frame.shape[1::-1], Image.Resampling.BOX))
        edge = 2 * len(frame) // size.rows
        return shown[edge:-edge], frame[edge:-edge]
    inner = np.s_[2 * down : len(frame) - 2 * down, : frame.shape[1]]
    return screen[inner], frame[inner]


def psnr(one: U8, other: U8) -> float:
    """Return the peak signal-to-noise ratio in dB, infinite where both are equal."""
    if one.shape != other.shape:
        return -math.inf
    error = np.mean((one.astype(np.float32) - other) ** 2)
    return math.inf if error == 0.0 else 10.0 * math.log10(255.0**2 / float(error))


def _at_home(program: list[str]) -> list[str]:
    """Return the program with the real user's cache: kernels are compiled once, not for every terminal."""
    import platformdirs

    return ["env", f"XDG_CACHE_HOME={platformdirs.user_cache_path()}", *program]
