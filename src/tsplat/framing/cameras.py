"""What the training cameras tell: which way is up, for people hold them level, and where to stand in a room."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tsplat.camera import Pose, Vector
from tsplat.framing.bulk import bounds
from tsplat.framing.sample import Sample, quantile
from tsplat.framing.trim import trimmed_sample
from tsplat.scene import Gaussians
from tsplat.train_views import TrainViews

F64 = npt.NDArray[np.float64]

TURNS = 0.05
"""Cameras turn about what is up where their sides point so much more to one level direction than to the other."""

LEVEL = 0.25
"""They are held level where their sides lean by less, root mean square: 14 degrees."""

AXIS_COSINE = 0.996
"""Within 5 degrees of an axis, that is meant."""

INDOORS = 0.5
"""A scene is seen from inside where half of its cameras stand in the box of its bulk."""

CANDIDATES = 8
"""Cameras whose views are tried, spread over the list."""

SIDE_COSINE, SOME = 0.7, 0.05
"""A side of a scene was seen where a twentieth of the cameras stood within 45 degrees of it."""

LEAST_VOLUME = 1e-6
"""Of the box that the axes of a camera span: below, they are numbers of no camera."""


def up_of_cameras(views: TrainViews) -> Vector | None:
    """Return what is up if cameras are held level; None where they are not, or too few to tell."""
    rights, downs, _ = _axes(_sound(views))
    if len(rights) < 3:
        return None
    leans, directions = np.linalg.eigh(rights.T @ rights / len(rights))
    up = directions[:, 0] * -np.sign(downs.mean(axis=0) @ directions[:, 0] or 1.0)
    if leans[0] > LEVEL**2 or leans[1] < leans[0] + TURNS or -(downs @ up).mean() < 0.5:
        return None
    nearest = int(np.argmax(np.abs(up)))
    if abs(up[nearest]) > AXIS_COSINE:
        up = np.sign(up[nearest]) * np.eye(3)[nearest]
    x, y, z = (float(each) + 0.0 for each in up)
    return x, y, z


def poses_inside(gaussians: Gaussians, views: TrainViews, up: Vector) -> list[Pose]:
    """Return the views of some training cameras, held upright, first that which had most of the scene in view.

    None where most of the cameras stood around the scene, not in it.
    """
    frusta, inner = _sound(views), trimmed_sample(gaussians)
    box, eyes = bounds(inner), _eyes(frusta)
    inside = np.flatnonzero(((eyes > box.low) & (eyes < box.high)).all(axis=1))
    if not len(inside) > INDOORS * len(frusta):
        return []
    spread = inside[np.unique(np.linspace(0, len(inside) - 1, CANDIDATES).round().astype(int))]
    seen = {int(each): _seen(inner, frusta[each]) for each in spread}
    most = sorted((each for each in seen if seen[each].sum() > 0.0), key=lambda each: -seen[each].sum())
    forwards = _axes(frusta)[2]

    def pose(camera: int) -> Pose:
        eye, forward = eyes[camera], forwards[camera]
        distance = quantile((inner.means - eye) @ forward, seen[camera], 0.5)
        return Pose.look_at(eye, eye + distance * forward, up)

    return [pose(camera) for camera in most]


def was_seen(pose: Pose, views: TrainViews) -> bool:
    """Tell whether some of the training cameras stood on that side of what is looked at that this view shows."""
    up, target = np.asarray(pose.up), pose.target
    away = _eyes(_sound(views)) - target
    level = away - (away @ up)[:, None] * up
    back = np.asarray(pose.eye) - target
    back -= (back @ up) * up
    cosines = level @ back / np.maximum(np.linalg.norm(level, axis=1) * np.linalg.norm(back), 1e-30)
    return not len(cosines) or bool((cosines > SIDE_COSINE).mean() >= SOME)


def _sound(views: TrainViews) -> F64:
    """Return the frusta, [C, 3, 4], of cameras whose numbers are such that they stand somewhere."""
    frusta = views.frusta.astype(np.float64)
    frusta = frusta[np.isfinite(frusta).all(axis=(1, 2))]
    frusta = frusta[(np.linalg.norm(frusta[:, :, :3], axis=2) > 0.0).all(axis=1)]
    sound: F64 = frusta[np.abs(np.linalg.det(_unit_rows(frusta)[:, :, :3])) > LEAST_VOLUME]
    return sound


def _unit_rows(frusta: F64) -> F64:
    rows: F64 = frusta / np.linalg.norm(frusta[:, :, :3], axis=2)[:, :, None]
    return rows


def _axes(frusta: F64) -> tuple[F64, F64, F64]:
    """Return right, down and forward of each camera, unit, [C, 3] each."""
    rights, downs, forwards = _unit_rows(frusta)[:, :, :3].transpose(1, 0, 2)
    return _across(rights, forwards), _across(downs, forwards), forwards


def _across(axes: F64, forwards: F64) -> F64:
    # Where the principal point is off the middle, sideways and down lean towards the front.
    across: F64 = axes - (axes * forwards).sum(axis=1)[:, None] * forwards
    return np.asarray(across / np.linalg.norm(across, axis=1)[:, None], np.float64)


def _eyes(frusta: F64) -> F64:
    rows = _unit_rows(frusta)
    return np.asarray(np.linalg.solve(rows[:, :, :3], -rows[:, :, 3:])[:, :, 0], np.float64)


def _seen(inner: Sample, frustum: F64) -> F64:
    """Return the weights of what a camera has in view, 0 of all else."""
    sideways, down, depth = frustum[:, :3] @ inner.means.T + frustum[:, 3:]
    return np.where((np.abs(sideways) < depth) & (np.abs(down) < depth), inner.weights, 0.0)
