"""The loop against a terminal that remembers what it was sent, at a clock that is the real one."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from tests.viewer.states import a_state
from tsplat._jit import Progress
from tsplat.encode import EncodedFrame
from tsplat.errors import SaveError
from tsplat.rendering import RenderOptions
from tsplat.terminal.keys import Answered, Event, Key, Mouse, Resize, TerminalSize
from tsplat.terminal.pacing import FULL, Pacer
from tsplat.terminal.probe import Profile
from tsplat.viewer.loop import READING_SECONDS, REST_SECONDS, Viewer
from tsplat.viewer.picture import Drawn, Painter
from tsplat.viewer.spans import Span, painted
from tsplat.viewer.state import ViewerState


class FakeTerminal:
    """Hands out one batch of events after another, then q; keeps what was written and waited for."""

    profile = Profile(program="fake", version="1")
    question = b"(answer!)"

    def __init__(self, *batches: Sequence[Event]) -> None:
        self.batches: list[Sequence[Event]] = [*batches, [Key("q")]]
        self.written: list[bytes] = []
        self.waits: list[float] = []
        self.asked = 0
        self.suspended = 0
        self.starting = True

    def events(self, timeout: float) -> list[Event]:
        if timeout == 0.0 and self.starting:
            return []
        self.starting = False
        if self.asked:
            answers: list[Event] = [Answered()] * self.asked
            self.asked = 0
            return answers
        self.waits.append(timeout)
        assert len(self.waits) < 500, "the loop never comes to rest"
        if timeout < 1.0:
            threading.Event().wait(timeout)
            return []
        return list(self.batches.pop(0))

    def write(self, screen: bytes) -> None:
        self.asked += screen.endswith(self.question)
        if screen != self.question:
            self.written.append(screen.removesuffix(self.question))

    def synchronized(self, screen: bytes) -> bytes:
        return b"<" + screen + b">"

    def suspend(self) -> None:
        self.suspended += 1


class FakeEncoder:
    def __init__(self, name: str) -> None:
        self.name = name

    def clear(self) -> bytes:
        return f"(clear {self.name})".encode()

    def forget(self, cells: object) -> None:
        pass


class FakePainter(Painter):
    """Counts instead of drawing."""

    profile = FakeTerminal.profile
    left_behind = b""
    merges = False
    read = 1.0
    file = None

    def __init__(self) -> None:
        self.encoder = None
        self.views: list[ViewerState] = []
        self.exact: list[bool] = []
        self.refuse = False

    def warm_up(self, state: ViewerState) -> None:
        pass

    def draw(self, state: ViewerState, density: float = 1.0, *, exact: bool = True) -> Drawn:
        self.views.append(state)
        self.exact.append(exact)
        self.choose(state)
        return Drawn(np.zeros((2, 2, 3), np.uint8), 7, {"project": 1.0}, density, exact or not self.merges)

    def encode(
        self,
        state: ViewerState,
        frame: object,  # noqa: ARG002
        spans: Sequence[Span],
        fidelity: float = 1.0,  # noqa: ARG002
    ) -> tuple[EncodedFrame, bytes]:
        return EncodedFrame(b"(upload)", f"(draw {state.output})".encode()), painted(spans)

    def detail_status(self, drawn: Drawn) -> str:
        return "" if drawn.exact else "merged"

    def choose(self, state: ViewerState) -> FakeEncoder:  # type: ignore[override]
        self.encoder = FakeEncoder(state.output)  # type: ignore[assignment]
        return self.encoder  # type: ignore[return-value]

    def clear(self) -> bytes:
        return self.left_behind

    def save(self, state: ViewerState, path: Path) -> Path:  # noqa: ARG002
        if self.refuse:
            raise SaveError(f"{path}: cannot be written: no room; choose another folder")
        path.touch()
        return path


def run(
    tmp_path: Path, *batches: Sequence[Event], state: ViewerState | None = None
) -> tuple[Viewer, FakeTerminal]:
    terminal, painter = FakeTerminal(*batches), FakePainter()
    viewer = Viewer(terminal, painter, state or a_state(), "tsplat-x", tmp_path)
    viewer.run()
    return viewer, terminal


def views(viewer: Viewer) -> list[ViewerState]:
    assert isinstance(viewer.painter, FakePainter)
    return viewer.painter.views


def test_one_frame_is_one_write_in_the_order_terminals_need(tmp_path: Path) -> None:
    _, terminal = run(tmp_path)
    (written,) = terminal.written
    order = [written.index(part) for part in (b"\x1b[2J", b"(upload)", b"<", b"(draw kitty)", b"splats", b">")]
    assert order == sorted(order)


def test_at_rest_nothing_is_drawn_and_the_loop_sleeps(tmp_path: Path) -> None:
    viewer, terminal = run(tmp_path, [], [], [Key("x")], [Mouse("move", "none", 3, 4)])
    assert len(views(viewer)) == len(terminal.written) == 1
    assert terminal.waits == [REST_SECONDS] * 5


def test_a_tap_draws_until_its_time_is_over_and_then_rests(tmp_path: Path) -> None:
    viewer, terminal = run(tmp_path, [Key("w")])
    assert 2 < len(views(viewer)) < 30
    assert terminal.waits[-1] == REST_SECONDS
    assert all(wait <= 1 / 60 for wait in terminal.waits[1:-1])
    assert viewer.state.pose != a_state().pose


def test_motion_never_exceeds_60_frames_a_second(tmp_path: Path) -> None:
    viewer, _ = run(tmp_path, [Key("w")])
    assert viewer.intervals
    assert min(viewer.intervals) >= 1 / 60 - 1e-3


def test_text_alone_is_drawn_without_rendering_again(tmp_path: Path) -> None:
    viewer, terminal = run(tmp_path, [Key("tab")])
    assert len(views(viewer)) == 1
    assert len(terminal.written) == 2
    assert b"antialias" in terminal.written[1]
    assert b"\x1b[2J" not in terminal.written[1]


def test_closing_the_hud_erases_its_cells_before_the_picture(tmp_path: Path) -> None:
    _, terminal = run(tmp_path, [Key("tab")], [Key("tab")])
    closed = terminal.written[2]
    assert b"antialias" not in closed
    assert closed.index(b"\x1b[1;1H\x1b[44X") < closed.index(b"(draw kitty)")


def test_the_next_output_clears_what_the_last_one_left(tmp_path: Path) -> None:
    _, terminal = run(tmp_path, [Key("m")])
    switched = terminal.written[1]
    order = [switched.index(part) for part in (b"(clear kitty)", b"\x1b[2J", b"(draw sixel)")]
    assert order == sorted(order)
    assert b"(clear" not in terminal.written[0]


def test_a_resize_draws_everything_from_nothing_even_at_the_same_size(tmp_path: Path) -> None:
    size = a_state().size
    viewer, terminal = run(tmp_path, [Resize(size)], [Resize(TerminalSize(100, 30, 10, 20))])
    assert len(views(viewer)) == 2
    assert all(b"\x1b[2J" in written for written in terminal.written)
    assert len(terminal.written) == 3


def test_after_a_resize_sixel_is_drawn_again_once_the_terminal_has_settled(tmp_path: Path) -> None:
    size = a_state().size
    _, terminal = run(tmp_path, [Resize(size)], [], state=a_state(output="sixel"))
    assert sum(b"\x1b[2J" in written for written in terminal.written) == 3
    assert terminal.waits[-1] == REST_SECONDS


def test_p_saves_under_a_new_name_each_time_and_says_where(tmp_path: Path) -> None:
    viewer, terminal = run(tmp_path, [Key("p")], [Key("P")])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["tsplat-x-001.png", "tsplat-x-002.png"]
    assert viewer.state.message == ""
    assert b"saved tsplat-x-001.png in " in terminal.written[1]


def test_a_picture_that_cannot_be_saved_is_a_message_and_no_end(tmp_path: Path) -> None:
    terminal, painter = FakeTerminal([Key("p")], []), FakePainter()
    painter.refuse = True
    Viewer(terminal, painter, a_state(size=TerminalSize(400, 24, 10, 20)), "tsplat-x", tmp_path).run()
    assert b"tsplat-x-001.png: cannot be written: no room" in terminal.written[1]


def test_ctrl_z_suspends_once(tmp_path: Path) -> None:
    _, terminal = run(tmp_path, [Key("ctrl+z")], [Resize(a_state().size)])
    assert terminal.suspended == 1
    assert b"\x1b[2J" in terminal.written[-1]


def test_a_slow_start_says_what_it_waits_for_and_can_be_quit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tsplat.warmup.progress", lambda: None)  # other tests may be compiling something
    done = threading.Event()

    class SlowPainter(FakePainter):
        def warm_up(self, state: ViewerState) -> None:  # noqa: ARG002
            done.wait(20.0)

    class Impatient(FakeTerminal):
        def events(self, timeout: float) -> list[Event]:  # noqa: ARG002
            return [Key("q")] if self.written else []

    terminal = Impatient()
    try:
        Viewer(terminal, SlowPainter(), a_state(), "tsplat-x", tmp_path).run()
    finally:
        done.set()
    assert b"starting" in terminal.written[0]
    assert b"(draw" not in b"".join(terminal.written)


def test_a_start_that_compiles_says_how_far_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Compiling(FakePainter):
        def warm_up(self, state: ViewerState) -> None:  # noqa: ARG002
            assert terminal.told.wait(20.0)

    class Told(FakeTerminal):
        told = threading.Event()

        def write(self, screen: bytes) -> None:
            super().write(screen)
            self.told.set()

    monkeypatch.setattr("tsplat.warmup.progress", lambda: Progress(4, 38, 5.2))
    terminal = Told()
    Viewer(terminal, Compiling(), a_state(), "tsplat-x", tmp_path).run()
    assert b" compiling kernels, first run only: 4 of 38, 5 s " in terminal.written[0]
    assert b"starting" not in terminal.written[0]


def test_a_notice_is_in_the_middle_and_never_wider_than_the_screen(tmp_path: Path) -> None:
    viewer = Viewer(FakeTerminal(), FakePainter(), a_state(), "tsplat-x", tmp_path)
    assert viewer.notice("start") == b"\x1b[12;37H start "
    assert viewer.notice("x" * 100) == b"\x1b[12;1H " + b"x" * 79


def test_below_sixel_the_screen_has_the_scenes_background(tmp_path: Path) -> None:
    state = a_state(output="sixel", options=RenderOptions(background=(1.0, 0.5, 0.0)))
    _, terminal = run(tmp_path, [Key("p")], [Key("x")], state=state)
    assert b"\x1b[0;48;2;255;128;0m\x1b[2J" in terminal.written[0]
    assert b"\x1b[0;48;2;255;128;0m\x1b[24;1H" in terminal.written[2]


def test_no_picture_stays_behind_whatever_ends_the_session(tmp_path: Path) -> None:
    class Killed(FakeTerminal):
        def events(self, timeout: float) -> list[Event]:
            if self.written and not timeout < 1.0:
                raise SystemExit(143)
            return super().events(timeout)

    for terminal, end in ((FakeTerminal(), contextlib.nullcontext()), (Killed(), pytest.raises(SystemExit))):
        painter = FakePainter()
        painter.left_behind = b"(clear)"
        with end:
            Viewer(terminal, painter, a_state(), "tsplat-x", tmp_path).run()
        assert terminal.written[-1] == b"(clear)"


def test_what_the_terminal_answers_late_is_taken_over_with_the_new_size(tmp_path: Path) -> None:
    terminal, painter = FakeTerminal([Resize(a_state().size)]), FakePainter()
    terminal.profile = Profile(program="fake", colors=1 << 24, sixel=True, kitty_keyboard=True)
    viewer = Viewer(terminal, painter, a_state(), "tsplat-x", tmp_path)
    viewer.run()
    assert viewer.state.releases
    assert "sixel" in viewer.state.outputs
    assert "kitty" in viewer.state.outputs
    assert painter.profile is terminal.profile


def test_an_error_while_drawing_is_not_swallowed(tmp_path: Path) -> None:
    class Broken(FakePainter):
        def draw(self, state: ViewerState, density: float = 1.0, *, exact: bool = True) -> Drawn:  # noqa: ARG002
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        Viewer(FakeTerminal(), Broken(), a_state(), "tsplat-x", tmp_path).run()


class SlowLink(FakeTerminal):
    """Answers a frame only when the events it is given say so."""

    def events(self, timeout: float) -> list[Event]:
        self.asked = 0
        return super().events(timeout)


class PiecesPainter(FakePainter):
    """Its pieces say which they are."""

    divisible = False  # type: ignore[assignment]

    def pieces(self, state: ViewerState, frame: object, spans: Sequence[Span], size: int) -> Iterator[bytes]:  # noqa: ARG002
        yield from (b"(piece %d)" % number for number in range(3))

    def abandon(self) -> bytes:
        return b"(abandoned)"


def on_a_slow_link(tmp_path: Path, *batches: Sequence[Event]) -> tuple[Viewer, SlowLink]:
    terminal, painter, pacer = SlowLink([Answered()], *batches), PiecesPainter(), Pacer(remote=True)
    viewer = Viewer(terminal, painter, a_state(), "tsplat-x", tmp_path, pacer)
    viewer.run()
    return viewer, terminal


def test_while_two_frames_are_unanswered_none_leaves_and_then_only_the_newest(tmp_path: Path) -> None:
    keys: list[list[Event]] = [[Key("tab")], [Key("?")], [Key("tab")], [Key("m")]]
    _, terminal = on_a_slow_link(tmp_path, *keys, [Answered(), Answered()], [])
    first, second, newest, *_ = terminal.written
    assert b"(draw kitty)" in first
    assert b"antialias" in second
    assert b"(draw sixel)" in newest
    assert b"output: sixel" in newest
    assert not any(b"quit" in written for written in terminal.written)


def test_once_at_rest_the_whole_picture_comes_in_pieces_and_then_nothing(tmp_path: Path) -> None:
    answers = [[Answered()]] * 5
    viewer, terminal = on_a_slow_link(tmp_path, *answers, [])
    assert terminal.written[1:] == [b"<(piece 0)>", b"<(piece 1)>", b"<(piece 2)>"]
    assert viewer.screen is not None
    assert viewer.screen.quality == FULL
    assert terminal.waits[-2:] == [REST_SECONDS] * 2


def test_a_key_ends_the_pieces_and_its_frame_comes_next(tmp_path: Path) -> None:
    _, terminal = on_a_slow_link(tmp_path, [Answered()], [Answered(), Key("tab")], [Answered()], [])
    assert terminal.written[1] == b"<(piece 0)>"
    followed = next(written for written in terminal.written[1:] if b"(draw kitty)" in written)
    assert followed.startswith(b"(abandoned)")
    assert b"antialias" in followed


def test_while_the_view_moves_frames_are_as_good_as_the_link_allows(tmp_path: Path) -> None:
    viewer, _ = on_a_slow_link(tmp_path, [Answered()], [])
    assert viewer.screen is not None
    assert views(viewer)[0] == a_state()
    assert viewer.pacer.quality.density < 1.0


class MergingPainter(PiecesPainter):
    """Says that it merged splats wherever it may."""

    merges = True


def test_splats_are_merged_while_the_view_moves_and_all_are_drawn_once_it_rests(tmp_path: Path) -> None:
    terminal, painter = FakeTerminal([Key("w")]), MergingPainter()
    viewer = Viewer(terminal, painter, a_state(), "tsplat-x", tmp_path)
    viewer.run()
    first, *moving, last = painter.exact
    assert first
    assert last
    assert len(moving) > 2
    assert not any(moving)
    assert viewer.screen is not None
    assert viewer.screen.quality == FULL


def test_where_nothing_is_merged_a_view_that_rests_is_not_drawn_again(tmp_path: Path) -> None:
    viewer, terminal = run(tmp_path, [Key("w")])
    assert not any(b"piece" in written for written in terminal.written)
    assert len(views(viewer)) == len(terminal.written)


@pytest.mark.parametrize(("on_disk", "exact"), [(False, [True]), (True, [False, True])])
def test_a_scene_on_disk_shows_merged_before_it_is_whole(tmp_path: Path, on_disk: bool, exact: list[bool]) -> None:
    painter = MergingPainter()
    Viewer(FakeTerminal(), painter, a_state(on_disk=on_disk), "tsplat-x", tmp_path).run()
    assert painter.exact == exact


class ReadingPainter(FakePainter):
    """Has a third more of its scene each time it is looked at between two waits, and merges until it has all."""

    terminal: FakeTerminal

    @property
    def read(self) -> float:  # type: ignore[override]
        return min(1.0, len(self.terminal.waits) / 3)

    @property
    def merges(self) -> bool:  # type: ignore[override]
        return self.read < 1.0

    def draw(self, state: ViewerState, density: float = 1.0, *, exact: bool = True) -> Drawn:
        return super().draw(state, density, exact=exact and self.read == 1.0)


def test_a_scene_that_is_read_meanwhile_is_drawn_again_until_all_of_it_is_there(tmp_path: Path) -> None:
    terminal, painter = FakeTerminal(), ReadingPainter()
    painter.terminal = terminal
    Viewer(terminal, painter, a_state(on_disk=True), "tsplat-x", tmp_path).run()
    assert painter.exact[:3] == [False] * 3
    assert painter.exact[3:] == [True]
    assert [wait for wait in terminal.waits if wait > 1 / 60] == [READING_SECONDS] * 3 + [REST_SECONDS]
