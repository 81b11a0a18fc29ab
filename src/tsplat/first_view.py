"""The view that every command begins with: that of `tsplat.framing`, from another side where this shows more.

Four small frames of a part of the splats tell a back from a front, an edge from a face, and a place inside a
floater from one outside.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tsplat.camera import Pose, Vector
from tsplat.framing import Up, guess_up, poses_inside, start_pose, was_seen
from tsplat.rendering import RenderOptions
from tsplat.scene import SH_C0, Gaussians

if TYPE_CHECKING:
    from tsplat.lod import Stored

F32 = npt.NDArray[np.float32]

SIZE = 240, 160
"""Pixels of a trial."""

SIDES = 4
"""Trials, a quarter of a turn apart."""

TRIAL_SPLATS = 1 << 15
"""Splats of a trial, each as much larger as there are fewer: so the four take no longer where there are more."""

NEAR = 0.35
"""What is nearer than this share of the way to the middle stands in the way."""

BETTER = 1.4
"""Another side is taken only if it is so many times as good: where they are alike, the usual one is best."""

LUMA = np.array([0.2126, 0.7152, 0.0722], np.float32)
"""How bright each primary looks, ITU-R BT.709."""


@dataclass(frozen=True, slots=True)
class FirstView:
    """Where to begin.

    Attributes
    ----------
    pose : Pose
        The view.
    up : Up
        Which way is up in it, and how that is known.
    cameras : tuple of Pose
        Views of training cameras, where the scene is seen from inside; else none.
    """

    pose: Pose
    up: Up
    cameras: tuple[Pose, ...] = ()


def first_view(
    scene: Gaussians | Stored,
    options: RenderOptions,
    *,
    aspect: float,
    fov_y: float,
    up: Vector | None = None,
    spz: bool = False,
) -> FirstView:
    """Return the view of a scene to begin with.

    Parameters
    ----------
    scene : Gaussians or Stored
        In memory, or on disk; of a streamed one its coarsest levels are enough.
    options : RenderOptions
        How it is going to be drawn; ``train_views`` says where its cameras stood.
    aspect : float
        Width over height of the image, positive.
    fov_y : float
        Vertical field of view in degrees, between 0 and 180.
    up : tuple of 3 floats, optional
        Direction that is up; guessed by default.
    spz : bool
        As in `tsplat.framing.guess_up`.

    Returns
    -------
    FirstView
        The same for the same arguments.

    Raises
    ------
    CameraError
        An argument is out of its range.
    """
    standing = where_to_stand(scene, options, aspect=aspect, fov_y=fov_y, up=up, spz=spz)
    return best_side(scene, options, standing, aspect=aspect, fov_y=fov_y)


def where_to_stand(
    scene: Gaussians | Stored,
    options: RenderOptions,
    *,
    aspect: float,
    fov_y: float,
    up: Vector | None = None,
    spz: bool = False,
) -> FirstView:
    """Do as `first_view` as far as that takes no drawing: no kernel is needed."""
    some, views = framed_by(scene), options.train_views
    found = guess_up(some, views, spz=spz) if up is None else Up(up, "said", "sure")
    if views and (cameras := poses_inside(some, views, found.direction)):
        return FirstView(cameras[0], found, tuple(cameras))
    return FirstView(start_pose(some, aspect=aspect, fov_y=fov_y, up=found.direction), found)


def best_side(
    scene: Gaussians | Stored, options: RenderOptions, view: FirstView, *, aspect: float, fov_y: float
) -> FirstView:
    """Return the view from that side, or at that camera, which shows most: mostly the one given."""
    if not len(scene):
        return view
    if view.cameras:
        return replace(view, pose=view.cameras[int(np.argmax(_scores(scene, options, view.cameras, fov_y)))])
    turns = [2.0 * math.pi * side / SIDES for side in range(SIDES)]
    poses = [view.pose.orbit(turn, 0.0) for turn in turns]
    scores = _scores(scene, options, poses, fov_y)
    if options.train_views:
        scores = [value * was_seen(pose, options.train_views) for value, pose in zip(scores, poses, strict=True)]
    best = int(np.argmax(scores))
    if not scores[best] > 0.0 or scores[best] < BETTER * scores[0]:
        return view
    pose = start_pose(framed_by(scene), aspect=aspect, fov_y=fov_y, up=view.pose.up, turn=turns[best])
    return replace(view, pose=pose)


def _scores(scene: Gaussians | Stored, options: RenderOptions, poses: Sequence[Pose], fov_y: float) -> list[float]:
    """Return how much each view shows; trials have a shape of their own, whatever that of the screen is."""
    from tsplat.raster import rasterize

    some = _thinned(scene)
    how = RenderOptions(
        antialias="relative",
        train_focal=options.train_focal,
        threads=options.threads,
        near_plane=options.near_plane,
        memory=options.memory,
        depths=False,
    )
    trials = (rasterize(marked(some, pose), pose.camera(*SIZE, fov_y), how) for pose in poses)
    return [score(trial.colors) for trial in trials]


def score(colors: F32) -> float:
    """Return how much a trial shows: the mean gradient of its luminance, less what stands in the way.

    Parameters
    ----------
    colors : ndarray of float32, [H, W, 3]
        Luminance, and how much of what is seen is near; see `marked`.
    """
    luminance = np.clip(colors[:, :, 0], 0.0, 1.0)
    across, down = np.diff(luminance, axis=1)[:-1], np.diff(luminance, axis=0)[:, :-1]
    return float(np.sqrt(across * across + down * down).mean()) * float((colors[:, :, 1] <= 0.5).mean())


def framed_by(scene: Gaussians | Stored) -> Gaussians:
    """Return what says where a scene is, and which way is up in it."""
    return scene if isinstance(scene, Gaussians) else scene.sample


def _thinned(scene: Gaussians | Stored) -> Gaussians:
    """Return some splats of a scene without harmonics, as much larger as there are fewer."""
    some = framed_by(scene)
    of = len(some) if isinstance(scene, Gaussians) else scene.sampled
    step = -(-len(some) // TRIAL_SPLATS)
    means, quats, opacities = some.means[::step], some.quats[::step], some.opacities[::step]
    larger = np.float32(max(1.0, math.sqrt(of / len(means))))
    return Gaussians(means, quats, some.scales[::step] * larger, opacities, some.sh[::step, :1])


def marked(some: Gaussians, pose: Pose) -> Gaussians:
    """Return splats whose red is their luminance, and whose green is 1 where they stand in the way.

    A frame with depths would tell as much, but takes a kernel of its own.
    """
    depths = (some.means - np.asarray(pose.eye, np.float32)) @ pose.forward.astype(np.float32)
    marks = np.zeros((len(some), 1, 3), np.float32)
    marks[:, 0, 0] = some.sh[:, 0] @ LUMA
    marks[:, 0, 1] = np.where(depths < NEAR * pose.distance, 0.5, -0.5) / np.float32(SH_C0)
    marks[:, 0, 2] = -0.5 / np.float32(SH_C0)
    return replace(some, sh=marks)
