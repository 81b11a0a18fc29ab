"""Comments of a PLY that say which way is up."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.io.plys import one_splat, ply_bytes, splats
from tsplat import io
from tsplat.framing import start_pose
from tsplat.io.ply_comments import up_of


@pytest.mark.parametrize(
    ("comment", "up"),
    [
        ("Vertical Axis: z", (0, 0, 1)),
        ("vertical_axis = -Y", (0, -1, 0)),
        ("Vertical Axis: +y", (0, 1, 0)),
        ("Vertical Axis: y", None),
        ("up axis Z", (0, 0, 1)),
        ("UpAxis: 'x'", (1, 0, 0)),
        ("axis_up: -z", (0, 0, -1)),
        ("Up: Y", (0, 1, 0)),
        ("right-handed, Z-up", (0, 0, 1)),
        ("z_up", (0, 0, 1)),
        ("ZUP", (0, 0, 1)),
        ("-Y up", (0, -1, 0)),
        ("y axis is up", (0, 1, 0)),
        ("Y down", (0, -1, 0)),
        ("up: 0 0 2", (0, 0, 1)),
        ("up_vector = (0, -3, 4)", (0, -0.6, 0.8)),
        ("up: 0 0 0", None),
        ("up: nan 0 1", None),
        ("up 1 2", None),
        ("clean up x", None),
        ("scaled up 1 2 3", None),
        ("set up: xyz", None),
        ("Created by CloudCompare v2.12", None),
    ],
)
def test_a_comment_says_what_is_up_in_many_spellings(comment: str, up: tuple[float, float, float] | None) -> None:
    said = up_of(comment)
    assert said is None if up is None else np.allclose(said or 0, up, atol=1e-12)


def test_the_start_view_obeys_the_last_comment_and_a_person_before_it(tmp_path: Path) -> None:
    path = tmp_path / "scene.ply"
    lines = b"comment Vertical Axis: x\ncomment Z-up\ncomment made by hand\n"
    path.write_bytes(ply_bytes([splats([one_splat()])]).replace(b"element", lines + b"element", 1))
    scene = io.load(path)
    assert scene.up == (0.0, 0.0, 1.0)
    assert start_pose(scene, aspect=1.5, fov_y=50.0).up == (0.0, 0.0, 1.0)
    assert start_pose(scene, aspect=1.5, fov_y=50.0, up=(0, 1, 0)).up == (0.0, 1.0, 0.0)


@pytest.mark.parametrize("suffix", [".ply", ".compressed.ply"])
@pytest.mark.parametrize("said", ["-y", "+y", "0.6 0 -0.8"])
def test_what_is_up_is_saved(tmp_path: Path, suffix: str, said: str) -> None:
    path = tmp_path / "scene.ply"
    path.write_bytes(
        ply_bytes([splats([one_splat()])]).replace(b"element", f"comment up: {said}\nelement".encode(), 1)
    )
    scene = io.load(path)
    kept = io.load(io.save(tmp_path / f"saved{suffix}", scene)).up
    assert np.allclose(scene.up or 0, kept or 1, atol=1e-9)
