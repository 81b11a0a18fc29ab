"""Laws of the viewer's pure core, and every key of the table."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.viewer.states import START, a_state
from tsplat.camera import PITCH_LIMIT, Pose
from tsplat.terminal.keys import Focus, Key, Mouse, Resize, TerminalSize
from tsplat.viewer.settings import SETTINGS
from tsplat.viewer.state import AUTO_ORBIT, TAP, Loaded, Notice, Tick, ViewerState, overlay, picture
from tsplat.viewer.update import COMMANDS, MOTION_KEYS, Event, update

NAMES = [*MOTION_KEYS, *(name.upper() for name in MOTION_KEYS if len(name) == 1), *COMMANDS]
keys = st.builds(Key, st.sampled_from(NAMES), st.sampled_from(["press", "repeat", "release"]))
mice = st.builds(
    Mouse,
    st.sampled_from(["press", "release", "drag", "move", "wheel"]),
    st.sampled_from(["left", "middle", "right", "none"]),
    st.floats(-5, 200),
    st.floats(-5, 100),
    st.sampled_from([-1, 0, 1]),
    st.booleans(),
)
ticks = st.builds(Tick, st.floats(0.0, 2.0))
sizes = st.builds(TerminalSize, st.integers(1, 300), st.integers(1, 100), st.integers(0, 20), st.integers(0, 40))
others = st.one_of(st.builds(Resize, sizes), st.builds(Focus, st.booleans()), st.builds(Notice, st.text()))
events = st.lists(st.one_of(keys, keys, mice, ticks, ticks, others), max_size=40)
states = st.builds(a_state, mode=st.sampled_from(["orbit", "fly"]), releases=st.booleans())


def after(state: ViewerState, *happened: Event) -> ViewerState:
    for event in happened:
        state = update(state, event)
    return state


def press(state: ViewerState, *names: str) -> ViewerState:
    return after(state, *(Key(name) for name in names))


def moved(state: ViewerState, name: str, seconds: float = 0.1) -> Pose:
    return after(state, Key(name), Tick(seconds)).pose


def same_view(one: Pose, other: Pose) -> bool:
    return np.allclose(one.eye, other.eye, atol=1e-9) and np.allclose(one.forward, other.forward, atol=1e-9)


@given(states, events)
def test_whatever_happens_the_camera_stays_possible(state: ViewerState, happened: list[Event]) -> None:
    end = after(state, *happened)
    assert abs(end.pose.pitch) <= PITCH_LIMIT
    assert end.pose.distance > 0.0
    assert np.isfinite(end.pose.eye).all()
    assert end.output in end.outputs
    assert 1 <= end.kept <= end.total
    assert 0 <= end.row < len(SETTINGS)
    end.pose.camera(64, 48, end.fov_y)


@given(states, events)
def test_the_state_after_the_events_can_be_compared_and_hashed(state: ViewerState, happened: list[Event]) -> None:
    one, other = after(state, *happened), after(state, *happened)
    assert one == other
    assert picture(one) == picture(other)
    assert hash(picture(one)) == hash(picture(other))


@given(st.lists(st.sampled_from(["j", "k", "h", "l", "left", "up", "+", "-"]), max_size=20), st.booleans())
def test_orbiting_keeps_its_target(names: list[str], auto: bool) -> None:
    state = a_state(auto_orbit=auto)
    for name in names:
        state = after(state, Key(name), Tick(0.07))
    assert np.allclose(state.pose.target, START.target, atol=1e-6)


@given(st.lists(st.sampled_from(["j", "k", "h", "l", "left", "up"]), max_size=20))
def test_turning_in_flight_keeps_the_eye(names: list[str]) -> None:
    state = a_state(mode="fly")
    for name in names:
        state = after(state, Key(name), Tick(0.07))
    assert state.pose.eye == START.eye


@given(states, events)
def test_changing_the_mode_never_moves_the_camera(state: ViewerState, happened: list[Event]) -> None:
    before = replace(after(state, *happened), held=(), message="")
    once = press(before, "space")
    assert once.pose == before.pose
    assert once.mode != before.mode
    twice = press(once, "space")
    assert replace(twice, message="", auto_orbit=before.auto_orbit) == before


@given(states, events, st.sampled_from(["e", "x", "0", "f5", "alt+w", "ctrl+w", "insert", "backspace", "é"]))
def test_unknown_keys_change_nothing(state: ViewerState, happened: list[Event], name: str) -> None:
    before = replace(after(state, *happened), message="")
    assert press(before, name) == before


@given(st.sampled_from(sorted(MOTION_KEYS)), st.sampled_from(["orbit", "fly"]), st.floats(0.01, 3.0))
def test_one_press_without_a_release_stops_by_itself(name: str, mode: str, seconds: float) -> None:
    state = after(a_state(mode=mode), Key(name), Tick(TAP))
    assert not state.moving
    assert after(state, Tick(seconds)) == state
    assert state.pose != START


@given(st.sampled_from(sorted(MOTION_KEYS)), st.floats(TAP, 3.0))
def test_a_slow_frame_does_not_make_a_press_longer(name: str, seconds: float) -> None:
    fly = a_state(mode="fly")
    assert after(fly, Key(name), Tick(seconds)).pose == after(fly, Key(name), Tick(TAP)).pose


@given(st.sampled_from(sorted(MOTION_KEYS)), st.lists(st.floats(0.001, 0.5), min_size=1, max_size=8))
def test_a_held_key_moves_until_its_release(name: str, seconds: list[float]) -> None:
    state = after(a_state(releases=True), Key(name))
    for step in seconds:
        state = after(state, Tick(step), Key(name, "repeat"))
        assert state.moving
    end = after(state, Key(name, "release"), Tick(TAP))
    assert not end.moving


@given(st.lists(st.floats(0.001, 0.1), min_size=1, max_size=20), st.sampled_from(["a", "r", "k", "+", "w"]))
def test_motion_depends_on_time_not_on_frames(steps: list[float], name: str) -> None:
    fly = a_state(mode="fly", releases=True)
    many = after(fly, Key(name), *(Tick(step) for step in steps)).pose
    one = after(fly, Key(name), Tick(sum(steps))).pose
    assert np.allclose(many.eye, one.eye, atol=1e-9)
    assert same_view(many, one)


def test_a_tap_shorter_than_a_frame_still_moves() -> None:
    state = after(a_state(releases=True), Key("w"), Key("w", "release"))
    assert state.moving
    assert after(state, Tick(1.0)).pose != START


def test_auto_repeat_keeps_a_key_held_where_no_release_is_reported() -> None:
    state = a_state()
    for _ in range(10):
        state = after(state, Key("d"), Tick(0.03))
        assert state.moving
    assert not after(state, Tick(TAP)).moving


def test_keys_go_up_when_the_window_loses_the_keyboard() -> None:
    held = after(a_state(releases=True), Key("w"))
    assert not after(held, Focus(False)).moving


@pytest.mark.parametrize("mode", ["orbit", "fly"])
@pytest.mark.parametrize(
    ("name", "axis"),
    [("w", "forward"), ("s", "back"), ("a", "left"), ("d", "right"), ("r", "up"), ("f", "down")],
)
def test_letters_move_eye_and_target_along_the_image(name: str, axis: str, mode: str) -> None:
    image_up = np.cross(START.right, START.forward)
    directions = {
        "forward": START.forward,
        "back": -START.forward,
        "right": START.right,
        "left": -START.right,
        "up": image_up,
        "down": -image_up,
    }
    for letter in (name, name.upper()):
        end = moved(a_state(mode=mode), letter)
        step = np.subtract(end.eye, START.eye)
        assert np.allclose(step / np.linalg.norm(step), directions[axis])
        assert np.allclose(end.target - START.target, step)


@pytest.mark.parametrize(("names", "sign"), [(["j", "J", "left"], -1), (["k", "K", "right"], 1)])
def test_yaw_keys_turn_the_flight_and_go_round_in_orbit(names: list[str], sign: int) -> None:
    for name in names:
        flown = moved(a_state(mode="fly"), name)
        assert np.sign(flown.forward @ START.right) == sign
        orbited = moved(a_state(), name)
        assert np.sign(np.subtract(orbited.eye, START.eye) @ START.right) == sign


@pytest.mark.parametrize(("names", "sign"), [(["h", "H", "up"], 1), (["l", "L", "down"], -1)])
def test_pitch_keys_raise_the_view_in_flight_and_the_eye_in_orbit(names: list[str], sign: int) -> None:
    for name in names:
        assert np.sign(moved(a_state(mode="fly"), name).pitch - START.pitch) == sign
        assert np.sign(np.subtract(moved(a_state(), name).eye, START.eye) @ np.array(START.up)) == sign


def test_plus_minus_and_the_wheel_zoom() -> None:
    for name in ("+", "="):
        assert moved(a_state(), name).distance < START.distance
    for name in ("-", "_"):
        assert moved(a_state(), name).distance > START.distance
    nearer = update(a_state(), Mouse("wheel", "none", 3, 3, wheel=1)).pose
    farther = update(a_state(), Mouse("wheel", "none", 3, 3, wheel=-1)).pose
    assert nearer.distance < START.distance < farther.distance
    assert np.allclose(nearer.target, START.target)


def drag(state: ViewerState, button: str, x: float, y: float, *, shift: bool = False) -> Pose:
    start = Mouse("press", button, 10, 10, shift=shift)  # type: ignore[arg-type]
    return after(state, start, Mouse("drag", button, 10 + x, 10 + y, shift=shift)).pose  # type: ignore[arg-type]


def project(pose: Pose, point: np.ndarray, fov_y: float = 55.0) -> np.ndarray:
    camera = pose.camera(800, 480, fov_y)
    x, y, z = camera.viewmat[:3, :3] @ point + camera.viewmat[:3, 3]
    assert z > 0
    return np.array([camera.K[0, 0] * x / z + camera.K[0, 2], camera.K[1, 1] * y / z + camera.K[1, 2]])


@pytest.mark.parametrize("mode", ["orbit", "fly"])
@pytest.mark.parametrize(("x", "y"), [(3, 0), (-3, 0), (0, 2), (0, -2)])
def test_a_drag_takes_the_picture_along(mode: str, x: int, y: int) -> None:
    end = drag(a_state(mode=mode), "left", x, y)
    near = START.target - 0.3 * START.forward
    step = project(end, near) - project(START, near)
    assert step @ np.array([x, y]) > 0
    if mode == "orbit":
        assert np.allclose(end.target, START.target)
    else:
        assert end.eye == START.eye


@pytest.mark.parametrize(("button", "shift"), [("right", False), ("left", True)])
def test_right_and_shift_drag_pan_so_that_the_target_stays_under_the_pointer(button: str, shift: bool) -> None:
    end = drag(a_state(), button, 4, 3, shift=shift)
    step = project(end, START.target) - project(START, START.target)
    assert np.allclose(step, [4 * 10, 3 * 20], atol=1e-6)
    assert np.allclose(end.forward, START.forward)


def test_motion_of_the_mouse_without_a_button_does_nothing() -> None:
    state = a_state()
    assert update(state, Mouse("move", "none", 40, 12)) == state
    released = after(state, Mouse("press", "left", 1, 1), Mouse("release", "left", 1, 1))
    assert after(released, Mouse("drag", "left", 40, 12)).pose == START


def test_auto_orbit_turns_at_a_constant_speed_in_wall_clock_time() -> None:
    orbiting = press(a_state(), "o")
    end = after(orbiting, *(Tick(0.25) for _ in range(8)))
    turned = math.degrees(abs(math.remainder(end.pose.yaw - START.yaw, math.tau)))
    assert turned == pytest.approx(2.0 * AUTO_ORBIT)
    assert not press(end, "O").moving
    assert press(a_state(mode="fly"), "o").mode == "orbit"


@pytest.mark.parametrize("name", ["z", "Z", "home"])
def test_z_and_home_return_to_the_start_view(name: str) -> None:
    away = after(a_state(), Key("w"), Tick(0.1), Key("k"), Tick(0.1), Key("o"))
    assert away.pose != START
    home = press(away, name)
    assert home.pose == START
    assert not home.moving


def test_m_goes_round_the_outputs_of_this_terminal() -> None:
    state, seen = a_state(outputs=("sixel", "half"), output="sixel"), []
    for _ in range(3):
        state = press(state, "m")
        seen.append(state.output)
    assert seen == ["half", "sixel", "half"]


def test_tab_opens_the_hud_and_escape_closes_it_before_it_quits() -> None:
    hud = press(a_state(), "tab")
    assert hud.panel == "hud"
    assert press(hud, "tab").panel == ""
    closed = press(hud, "escape")
    assert (closed.panel, closed.running) == ("", True)
    assert not press(closed, "escape").running


def test_question_mark_shows_the_keys_and_escape_hides_them() -> None:
    shown = press(a_state(), "?")
    assert shown.panel == "help"
    assert press(shown, "escape").panel == ""
    assert press(shown, "tab").panel == "hud"


@pytest.mark.parametrize("name", ["q", "Q", "ctrl+c", "escape"])
def test_q_ctrl_c_and_escape_quit(name: str) -> None:
    assert not press(a_state(), name).running


def test_ctrl_c_quits_while_a_panel_is_open() -> None:
    assert not press(a_state(), "tab", "ctrl+c").running


def test_p_and_ctrl_z_ask_the_loop_once_for_each_press() -> None:
    state = after(a_state(), Key("p"), Key("p", "repeat"), Key("p", "release"), Key("ctrl+z"), Key("ctrl+r"))
    assert (state.pictures, state.suspends, state.reloads) == (1, 1, 1)


def test_a_message_stays_until_the_next_key() -> None:
    state = update(a_state(), Notice("saved a.png"))
    assert after(state, Tick(5.0), Key("w", "release")).message == "saved a.png"
    assert press(state, "w").message == ""


def test_arrows_work_the_hud_and_letters_still_steer() -> None:
    hud = press(a_state(), "tab")
    down = press(hud, "down", "down")
    assert (down.row, down.moving) == (2, False)
    assert press(hud, "up").row == len(SETTINGS) - 1
    assert press(down, "left").options.sh_degree == 2
    assert moved(hud, "k") != START


def test_opening_a_panel_lets_go_of_what_was_held() -> None:
    held = after(a_state(releases=True), Key("up"))
    assert not press(held, "tab").moving


def test_the_keys_scroll_only_where_they_do_not_fit() -> None:
    low = a_state(panel="help", size=TerminalSize(40, 12))
    assert press(low, "down", "down", "up").scroll == 1
    assert press(a_state(panel="help"), "down").moving


def test_resizing_and_resuming_ask_for_a_new_screen() -> None:
    state = a_state()
    again = update(state, Resize(state.size))
    assert overlay(again) != overlay(state)
    assert picture(again) == picture(state)
    assert picture(update(state, Resize(TerminalSize(81, 24, 10, 20)))) != picture(state)


@given(states, st.sampled_from(["tab", "?", "p", "x"]))
def test_what_only_changes_text_leaves_the_picture(state: ViewerState, name: str) -> None:
    assert picture(press(state, name)) == picture(state)


def test_a_scene_that_was_loaded_again_changes_what_is_known_of_it_and_not_the_view() -> None:
    before = after(a_state(on_disk=True), Key("w"))
    state = update(before, Loaded(77, 1))
    assert (state.total, state.kept, state.scene_degree) == (77, 77, 1)
    assert (state.pose, state.held, state.options) == (before.pose, before.held, before.options)
    assert state.message == "loaded again"
