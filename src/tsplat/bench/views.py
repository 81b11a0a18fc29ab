"""The camera path: around the scene with the frame filled, then from within it, looking past its middle."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tsplat.camera import Camera, Pose
from tsplat.first_view import first_view
from tsplat.framing import bulk
from tsplat.options import near_plane
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians

FOV_Y = 55.0
AROUND = 3
"""Views of each kind, a third of a turn apart: every side is seen, and the run stays short."""

VIEWS = 2 * AROUND
"""Views of the whole path."""

ASIDE, ABOVE, BEHIND = 0.2, 0.1, 0.3
"""Where the eye stands inside, in radii from the middle: close enough to be among the splats, and looking past
the middle, so that the view is not empty when the scene is a single thing."""


@dataclass(frozen=True, eq=False, slots=True)
class View:
    """A camera with a name fit for a table."""

    name: str
    camera: Camera


def camera_path(gaussians: Gaussians, width: int, height: int) -> tuple[View, ...]:
    """Return the views of a scene, the same for the same scene and size.

    Parameters
    ----------
    gaussians : Gaussians
        Any scene.
    width, height : int
        Size of the image in pixels, 1 to 16384.

    Returns
    -------
    tuple of View
        Three from outside, where the bulk of the scene fills the frame, and three from inside.

    Raises
    ------
    CameraError
        A side is out of its range.
    """
    start = first_view(
        gaussians,
        RenderOptions(depths=False, near_plane=near_plane(gaussians)),
        aspect=width / height,
        fov_y=FOV_Y,
    ).pose
    middle = bulk(gaussians)
    ahead = Pose.look_at(tuple(middle.center), tuple(middle.center + start.forward), start.up)
    level = ahead.turn(0.0, -ahead.pitch)
    step = ASIDE * middle.radius, ABOVE * middle.radius, -BEHIND * middle.radius
    turns = [2.0 * math.pi * turn / AROUND for turn in range(AROUND)]
    poses = [(f"outside {turn}", start.orbit(yaw, 0.0)) for turn, yaw in enumerate(turns, 1)]
    poses += [(f"inside {turn}", level.turn(yaw, 0.0).move(*step)) for turn, yaw in enumerate(turns, 1)]
    return tuple(View(name, pose.camera(width, height, FOV_Y)) for name, pose in poses)
