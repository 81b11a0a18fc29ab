"""Sessions recorded: in a real pty, and replayed from views at made-up times."""

from __future__ import annotations

import io
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from tests.record.casts import read_cast, screen_of
from tests.scenes import random_gaussians
from tests.terminal.ptys import Terminal
from tests.test_export import FLOORS, psnr, read
from tests.viewer.states import a_state
from tsplat.camera import Pose
from tsplat.errors import SaveError
from tsplat.framing import start_pose
from tsplat.io import load, save
from tsplat.raster import rasterize
from tsplat.record.cast import Cast
from tsplat.record.live import CastSession, Replay, ViewRecorder
from tsplat.rendering import RenderOptions
from tsplat.terminal import Profile, Session
from tsplat.viewer.scenes import SceneVariants
from tsplat.viewer.state import ViewerState

pytestmark = pytest.mark.usefixtures("compiled")

GAUSSIANS = random_gaussians(np.random.default_rng(8), 400, sh_degree=0)
OLD_TERMINAL, WITH_SIXEL = b"\x1b[?1;2c", b"\x1b[?62;4c"


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    return save(tmp_path / "cloud.ply", GAUSSIANS)


class Answering(Terminal):
    """A terminal that says each time it is asked that it has got so far."""

    answered = 0

    def _read(self, deadline: float) -> bool:
        came = super()._read(deadline)
        while self.answered < self.seen.count(b"\x1b[5n"):
            self.type(b"\x1b[0n")
            self.answered += 1
        return came

    def until_it_rests(self) -> None:
        """Read until nothing has come for a while."""
        while self._read(time.monotonic() + 0.7):
            pass


@contextmanager
def recording(out: Path, scene: Path, *args: str, answer: bytes = OLD_TERMINAL) -> Iterator[Answering]:
    """Open the viewer, recorded, in a terminal that can do no more than it says with this answer."""
    call = ["record", str(out), str(scene), "--live", *args]
    script = f"import sys\nfrom tsplat import cli\nsys.exit(cli.main({call!r}))"
    kept = {name: text for name, text in os.environ.items() if name.startswith(("HOME", "XDG_", "NUMBA_"))}
    with Answering.python(script, kept | {"COLORTERM": "truecolor"}) as terminal:
        assert isinstance(terminal, Answering)
        terminal.wait_for(b"\x1b[c")
        terminal.type(answer)
        terminal.wait_for(b"splats ")
        terminal.until_it_rests()
        yield terminal


def turn_and_quit(terminal: Answering) -> None:
    """Turn the camera, wait until that is seen, and leave."""
    start = len(terminal.seen)
    terminal.type(b"k")
    terminal.wait_for("\u2580".encode(), start=start)
    terminal.until_it_rests()
    terminal.type(b"q")
    assert terminal.wait() == 0


def test_a_cast_of_a_session_holds_what_the_terminal_got(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "x.cast"
    with recording(out, scene, "--output", "half") as terminal:
        turn_and_quit(terminal)
        seen = terminal.seen
    header, events = read_cast(out.read_bytes())
    assert (header["term"]["cols"], header["term"]["rows"], header["title"]) == (80, 24, "cloud")
    assert header["timestamp"] > 1.7e9
    assert events[-1].kind == "x"
    *drawn, restored = [event for event in events if event.kind == "o"]
    assert restored.text == "\x1b[0m\x1b[?25h\x1b[?1049l"
    at = 0
    for event in drawn[1:]:
        assert (at := seen.find(event.text.encode(), at)) >= 0
    assert seen.count(b"splats ") == sum(event.text.count("splats ") for event in drawn)
    screen = screen_of(header, events[:-2])
    assert "splats" in screen.display[0]
    cells = [screen.buffer[row][column] for row in range(4, 20) for column in range(80)]
    assert len({(cell.fg, cell.bg) for cell in cells}) > 50
    assert f"{out}: a session, " in seen.decode()


def test_times_of_a_session_are_those_of_the_clock(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "x.cast"
    with recording(out, scene, "--output", "half") as terminal:
        turn_and_quit(terminal)
    _, events = read_cast(out.read_bytes())
    frames = [event.seconds for event in events if "\u2580" in event.text]
    assert len(frames) >= 3
    assert all(later > earlier for earlier, later in pairwise(frames))
    assert 0.0 < frames[0] < frames[-1] < events[-1].seconds - 0.5
    assert frames[1] - frames[0] > 0.5  # before the key
    assert events[-1].seconds < 60.0


@pytest.mark.parametrize("output", ["kitty", "sixel"])
def test_a_cast_of_a_session_is_made_of_text_whatever_is_asked_for(
    scene: Path, tmp_path: Path, output: str
) -> None:
    out = tmp_path / "x.cast"
    with recording(out, scene, "--output", output, answer=WITH_SIXEL) as terminal:
        for _ in range(3):  # outputs, one after another
            before = len(terminal.seen)
            terminal.type(b"m")
            terminal.wait_for("\u2580".encode(), start=before)
        terminal.type(b"q")
        assert terminal.wait() == 0
    _, events = read_cast(out.read_bytes())
    text = "".join(event.text for event in events)
    assert "\u2580" in text
    assert not any(start in text for start in ("\x1b_", "\x1bP", "\x1b]"))


def test_a_resize_is_recorded_before_the_picture_of_its_size(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "x.cast"
    with recording(out, scene, "--output", "half") as terminal:
        before = len(terminal.seen)
        terminal.resize(50, 12)
        terminal.wait_for(b"splats ", start=before)
        terminal.type(b"q")
        assert terminal.wait() == 0
    header, events = read_cast(out.read_bytes())
    resized = [index for index, event in enumerate(events) if event.kind == "r"]
    assert events[resized[0]].text == "50x12"
    assert any("splats " in event.text for event in events[resized[0] :])
    screen = screen_of(header, events[:-2])
    assert (screen.columns, screen.lines) == (50, 12)
    assert screen.display[6] == "\u2580" * 50


def test_a_picture_of_a_session_has_its_own_size_and_shows_what_was_seen(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "x.gif"
    size = "--width", "64", "--height", "48", "--fps", "50"
    with recording(out, scene, "--output", "half256", "--antialias", "classic", *size) as terminal:
        turn_and_quit(terminal)
    frames, seconds = read(out)
    assert len(frames) >= 3
    assert 0.02 <= seconds < 60.0
    gaussians = load(scene)
    start = start_pose(gaussians, aspect=80 * 10 / (24 * 20), fov_y=55.0)
    expected = rasterize(gaussians, start.camera(64, 48, 55.0), RenderOptions()).frame()
    assert psnr(frames[0], expected) > FLOORS[".gif"] - 4
    assert psnr(frames[-1], expected) < psnr(frames[0], expected) - 3


def test_a_session_that_is_killed_leaves_no_file(scene: Path, tmp_path: Path) -> None:
    with recording(tmp_path / "x.cast", scene) as terminal:
        terminal.process.terminate()
        assert terminal.wait() != 0
        assert b"\x1b[?1049l" in terminal.seen
    assert [path.name for path in tmp_path.iterdir()] == ["cloud.ply"]


def test_questions_to_the_terminal_are_not_recorded(monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[bytes] = []
    monkeypatch.setattr(Session, "write", lambda _, screen: sent.append(screen))
    file = io.BytesIO()
    session = CastSession(file, "x")
    session.write(b"before it is entered")
    session._cast = Cast(file, 9, 3)
    session.write(b"frame\x1b[5n")
    assert sent == [b"before it is entered", b"frame\x1b[5n"]
    _, events = read_cast(file.getvalue())
    assert [event.text for event in events] == ["frame"]


class CountingScenes(SceneVariants):
    def __init__(self) -> None:
        super().__init__(GAUSSIANS)
        self.asked: list[tuple[int, bool]] = []

    def variant(self, kept: int, raw_opacity: bool):  # type: ignore[no-untyped-def]
        self.asked.append((kept, raw_opacity))
        return super().variant(kept, raw_opacity)


def seen(*views: tuple[float, ViewerState]) -> ViewRecorder:
    recorder = ViewRecorder()
    recorder.times, recorder.views = [time for time, _ in views], [view for _, view in views]
    return recorder


def from_side(yaw: float, **changes: object) -> ViewerState:
    pose: Pose = a_state().pose.orbit(yaw, 0.0)
    return a_state(pose=pose, kept=400, total=400, **changes)


def test_a_replay_shows_at_each_time_the_last_view_that_had_come() -> None:
    sides = [from_side(0.7 * index) for index in range(3)]
    scenes = CountingScenes()
    replay = Replay(seen((5.0, sides[0]), (5.25, sides[1]), (5.28, sides[2])), scenes, (32, 24), 10, 5.6)
    assert len(replay) == 6
    frames = [replay[index] for index in range(6)]
    alone = [Replay(seen((0.0, side)), SceneVariants(GAUSSIANS), (32, 24), 10, 0.0)[0] for side in sides]
    assert [next(i for i in range(3) if np.array_equal(frame, alone[i])) for frame in frames] == [0, 0, 0, 2, 2, 2]
    assert len(scenes.asked) == 2


@pytest.mark.parametrize(
    "change",
    [
        {"saturation": 0.0},
        {"fov_y": 30.0},
        {"kept": 40},
        {"raw_opacity": True},
        {"options": RenderOptions(background=(1.0, 1.0, 1.0))},
    ],
    ids=lambda change: next(iter(change)),
)
def test_what_was_set_in_the_viewer_shows_in_the_replay(change: dict[str, object]) -> None:
    plain = from_side(0.0)
    both = seen((0.0, plain), (1.0, replace(plain, **change)))  # type: ignore[arg-type]
    replay = Replay(both, SceneVariants(GAUSSIANS), (32, 24), 1, 2.0)
    assert replay[0].shape == (24, 32, 3)
    assert psnr(replay[0], replay[1]) < 35


def test_a_session_without_a_picture_cannot_be_replayed() -> None:
    with pytest.raises(SaveError, match="nothing is recorded"):
        Replay(ViewRecorder(), SceneVariants(GAUSSIANS), (32, 24), 10, 1.0)


def test_a_recorder_notes_a_view_once_and_only_what_can_be_seen() -> None:
    recorder = ViewRecorder()
    painter = recorder.painter(SceneVariants(GAUSSIANS), Profile())
    state = from_side(0.0, output="half")
    for shown in (state, replace(state, message="hello"), replace(state, saturation=0.5), state):
        assert painter.draw(shown).frame.shape == (48, 80, 3)
    assert [view.saturation for view in recorder.views] == [1.0, 0.5, 1.0]
    assert recorder.times == sorted(recorder.times)
