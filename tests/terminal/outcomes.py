"""What may come of bytes from a terminal, whoever it is: events of bounded size, a profile, a size to draw at."""

from __future__ import annotations

import math
from functools import cache

from tests.viewer.states import a_state
from tsplat.encode import ENCODERS, Encoder, encoder
from tsplat.terminal.keys import Answered, Mouse, Resize
from tsplat.terminal.limits import MOST_CELLS, MOST_COLUMNS, MOST_HELD, MOST_KEYS_DOWN, MOST_PIXELS, MOST_ROWS
from tsplat.terminal.outputs import offers
from tsplat.terminal.parser import Parser, PixelReport, SizeReport
from tsplat.terminal.probe import detect
from tsplat.terminal.sizes import Sizes
from tsplat.viewer.picture import MOST_PIXELS as MOST_DRAWN
from tsplat.viewer.picture import frame_size, view_camera
from tsplat.viewer.state import ViewerState
from tsplat.viewer.update import update

WINDOWS = ((0, 0, 0, 0), (80, 24, 800, 480), (65535, 65535, 65535, 65535), (1, 1, 65535, 65535), (65535, 1, 0, 0))
"""Columns, rows, width and height that a kernel may claim."""


def outcome(received: bytes, window: tuple[int, int, int, int] = WINDOWS[1]) -> ViewerState:
    """Hear all that a terminal sends, in pieces that its first byte says; return the state of the viewer then."""
    profile = detect({"TERM": "xterm"}, received, received.decode("latin-1"))
    assert all(reply.isprintable() and len(reply) <= 200 for reply in profile.replies.values())
    assert all(offer.why.isprintable() for offer in offers(profile))
    parser, sizes, state = Parser(), Sizes(lambda: window, profile), a_state(outputs=ENCODERS)
    piece = 1 + received[0] if received else 1
    for start in range(1, len(received), piece):
        for event in parser.feed(received[start : start + piece]):
            if isinstance(event, PixelReport | SizeReport):
                sizes.take(event)
                state = update(state, Resize(sizes.now()))
            elif isinstance(event, Mouse):
                assert math.isfinite(event.x + event.y)
                assert max(event.x, event.y) <= MOST_COLUMNS
                state = update(state, event)
            elif not isinstance(event, Answered):
                state = update(state, event)
        assert len(parser._rest) <= MOST_HELD
        assert len(parser._down) <= MOST_KEYS_DOWN
    check_drawable(update(state, Resize(sizes.now())))
    return state


def check_drawable(state: ViewerState) -> None:
    """Check that a frame of this state is of bounded size, and that there is a camera for it."""
    size = state.size
    assert 1 <= size.columns <= MOST_COLUMNS
    assert 1 <= size.rows <= MOST_ROWS
    assert size.columns * size.rows <= MOST_CELLS
    assert size.columns * size.rows * size.cell_width * size.cell_height <= MOST_PIXELS
    width, height = frame_size(state, _encoder(state.output))
    assert 1 <= width * height <= MOST_DRAWN
    view_camera(state, width, height)


@cache
def _encoder(name: str) -> Encoder:
    return encoder(name)
