"""What the viewer draws: the right size, the right shape, the right variant of the scene."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.scenes import random_gaussians
from tests.viewer.states import a_state
from tsplat.encode import ENCODERS, encoder
from tsplat.errors import SaveError
from tsplat.terminal.keys import TerminalSize
from tsplat.terminal.probe import Profile
from tsplat.viewer.picture import Painter, frame_size, free_path, saturated, view_camera
from tsplat.viewer.scenes import SceneVariants, activated, unactivated
from tsplat.viewer.spans import Span, shaded


@pytest.fixture(scope="module")
def painter() -> Painter:
    return Painter(SceneVariants(random_gaussians(np.random.default_rng(5), 200)))


def test_a_frame_has_the_pixels_of_the_cells_times_the_density() -> None:
    half, kitty = encoder("half"), encoder("kitty")
    assert frame_size(a_state(output="half"), half) == (80, 48)
    assert frame_size(a_state(output="half", density=2.0), half) == (160, 96)
    assert frame_size(a_state(density=0.5), kitty) == (400, 240)


def test_sixel_leaves_the_last_row_unused() -> None:
    assert frame_size(a_state(output="sixel"), encoder("kitty"))[1] == 23 * 20


@pytest.mark.parametrize("cell", [(10, 20), (9, 20), (0, 0), (16, 16)])
def test_the_view_is_never_stretched_whatever_the_cell(cell: tuple[int, int]) -> None:
    state = a_state(output="half", size=TerminalSize(100, 30, *cell))
    camera = view_camera(state, 100, 60)
    width, height = cell if all(cell) else (10, 20)
    # Pixels of the frame are as wide and high as a cell and half a cell on screen.
    assert camera.K[0, 0] * width == pytest.approx(camera.K[1, 1] * height / 2)
    assert camera.fov_y == pytest.approx(state.fov_y)


def test_drawing_gives_a_frame_and_its_bytes(painter: Painter) -> None:
    drawn = painter.draw(a_state(output="half", total=200, kept=200))
    assert drawn.frame.shape == (48, 80, 3)
    assert drawn.frame.max() > 50
    assert "composite" in drawn.stage_ms
    encoded, text = painter.encode(a_state(output="half"), drawn.frame, [])
    assert encoded.draw
    assert text == b""
    assert 0 < drawn.visible <= 200


@pytest.mark.parametrize("output", ENCODERS)
def test_warming_up_leaves_what_is_known_of_the_screen_alone(painter: Painter, output: str) -> None:
    before = painter.choose(a_state(output="half"))
    painter.warm_up(a_state(output=output))
    assert painter.encoder is before


def test_panels_over_kitty_are_in_the_picture_and_elsewhere_in_the_text(painter: Painter) -> None:
    frame = np.full((480, 800, 3), 255, np.uint8)
    spans = [Span(2, 10, "hello", "selected")]
    assert b"48;5" not in painter.encode(a_state(), frame, spans)[1]
    assert b"48;5;25" in painter.encode(a_state(output="half"), frame, spans)[1]
    dark = (shaded(frame, spans, 80, 24) != 255).any(axis=2)
    assert dark[40:60, 100:150].all()
    assert dark.sum() == 20 * 50


def test_a_picture_is_saved_large_in_the_shape_of_the_screen(painter: Painter, tmp_path: Path) -> None:
    state = a_state(total=200, kept=200)
    path = painter.save(state, free_path(tmp_path, "tsplat-x"))
    assert path.name == "tsplat-x-001.png"
    with Image.open(path) as picture:
        assert picture.size == (1920, 1152)
    assert free_path(tmp_path, "tsplat-x").name == "tsplat-x-002.png"


def test_a_picture_that_cannot_be_saved_says_so(painter: Painter, tmp_path: Path) -> None:
    with pytest.raises(SaveError, match="cannot be written"):
        painter.save(a_state(size=TerminalSize(2, 2, 1, 1)), tmp_path / "none" / "x.png")


def test_saturation_keeps_greys_and_brightness() -> None:
    colors = np.random.default_rng(1).uniform(size=(4, 5, 3)).astype(np.float32)
    assert saturated(colors, 1.0) is colors
    grey = saturated(colors, 0.0)
    assert np.allclose(grey, grey[..., :1], atol=1e-6)
    vivid = saturated(colors, 2.0)
    assert vivid.dtype == np.float32
    luma = np.array([0.2126, 0.7152, 0.0722])
    assert np.allclose(vivid @ luma, colors @ luma, atol=1e-5)
    assert np.ptp(vivid, axis=2).sum() > np.ptp(colors, axis=2).sum()


def test_fewer_splats_are_the_most_important_in_file_order() -> None:
    loaded = random_gaussians(np.random.default_rng(2), 50)
    scenes = SceneVariants(loaded)
    kept = scenes.variant(10, False)
    weight = loaded.opacities * (np.prod(loaded.scales, axis=1)[:, None] / loaded.scales).sum(axis=1)
    best = np.sort(np.argsort(weight)[-10:])
    assert np.array_equal(kept.means, loaded.means[best])
    assert scenes.variant(10, False) is kept
    assert scenes.variant(50, False).means is loaded.means


def test_raw_opacity_shows_the_number_under_the_sigmoid() -> None:
    loaded = random_gaussians(np.random.default_rng(2), 50)
    raw = SceneVariants(loaded).variant(50, True).opacities
    logit = [math.log(x / (1.0 - x)) for x in loaded.opacities.astype(float)]
    assert np.allclose(raw, np.clip(logit, 0.0, 1.0), atol=1e-4)
    shown = SceneVariants(loaded, raw_opacity=True).variant(50, False).opacities
    assert np.allclose(shown, 1.0 / (1.0 + np.exp(-loaded.opacities)), atol=1e-6)


def test_opacities_at_the_ends_stay_in_range() -> None:
    ends = np.array([0.0, 0.5, 1.0], np.float32)
    assert unactivated(ends).tolist() == [0.0, 0.0, 1.0]
    assert ((activated(ends) >= 0.5) & (activated(ends) < 1.0)).all()


def test_encoders_are_made_for_the_terminal_and_the_wish() -> None:
    scenes = SceneVariants(random_gaussians(np.random.default_rng(5), 20))
    profile = Profile(colors=0, sixel_size=(400, 300))
    state = a_state(output="sixel")
    gradient = np.linspace(0, 255, 460 * 800 * 3).reshape(460, 800, 3).astype(np.uint8)
    drawn = {}
    for dither in (False, True):
        encoded, _ = Painter(scenes, profile, dither=dither).encode(state, gradient, [])
        drawn[dither] = encoded.draw
        assert drawn[dither].count(b"\x1bP") == 4
    assert len(drawn[True]) > len(drawn[False])
    ascii_art, _ = Painter(scenes, profile).encode(a_state(output="ascii"), gradient, [])
    assert b"\x1b[38" not in ascii_art.draw
