"""Scenes of panels and clouds, whose ups, fronts and insides are known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tsplat.camera import Camera
from tsplat.rotations import quats_of
from tsplat.scene import SH_C0, Gaussians

Point = Sequence[float]


def joined(*parts: Gaussians) -> Gaussians:
    """Return several scenes as one."""
    names = ("means", "quats", "scales", "opacities", "sh")
    return Gaussians(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def colored(means: npt.ArrayLike, sizes: Point, colors: npt.ArrayLike, opacity: float = 0.95) -> Gaussians:
    """Return splats without rotation: standard deviations along x, y and z, colours from 0 to 1."""
    centres = np.asarray(means, np.float64).reshape(-1, 3)
    n = len(centres)
    sh = (np.broadcast_to(np.asarray(colors, np.float64), (n, 3)) - 0.5) / SH_C0
    quats = np.tile(np.array([1.0, 0.0, 0.0, 0.0]), (n, 1))
    scales, opacities = np.tile(np.asarray(sizes, np.float64), (n, 1)), np.full(n, opacity)
    return Gaussians(centres, quats, scales, opacities, sh[:, None])


def panel(
    corner: Point, first: Point, second: Point, color: Point = (0.5, 0.5, 0.5), *, checks: int = 0, side: int = 40
) -> Gaussians:
    """Return a flat rectangle between two edges from a corner, with so many light and dark fields a side."""
    edges = np.array([first, second], np.float64)
    normal = np.cross(*edges)
    steps = (np.arange(side) + 0.5) / side
    u, v = (each.ravel() for each in np.meshgrid(steps, steps))
    colors = np.tile(np.asarray(color, np.float64), (side * side, 1))
    if checks:
        dark = (np.floor(checks * u) + np.floor(checks * v)) % 2 == 1
        colors[dark] *= 0.2
    lengths = np.linalg.norm(edges, axis=1)
    axes = np.stack([*(edges / lengths[:, None]), normal / np.linalg.norm(normal)], axis=1)
    quat = quats_of(axes[None])[0]
    flat = colored(
        np.asarray(corner) + u[:, None] * edges[0] + v[:, None] * edges[1],
        (lengths[0] / side, lengths[1] / side, 0.02 * lengths.min() / side),
        colors,
    )
    return Gaussians(flat.means, np.tile(quat, (len(flat), 1)), flat.scales, flat.opacities, flat.sh)


def ball(
    center: Point, radius: float, size: float, color: Point, count: int = 800, opacity: float = 0.95
) -> Gaussians:
    """Return splats evenly spread over a ball's surface."""
    turn = np.arange(count) * np.pi * (3.0 - 5.0**0.5)
    height = 1.0 - 2.0 * (np.arange(count) + 0.5) / count
    level = np.sqrt(1.0 - height**2)
    points = np.stack([level * np.cos(turn), height, level * np.sin(turn)], axis=1)
    return colored(np.asarray(center) + radius * points, (size,) * 3, color, opacity)


def drone_scan(ditch: float = 0.0) -> Gaussians:
    """Return a wide flat ground at z = 0 with low houses and a tree on it, and perhaps a ditch: z is up."""
    houses = [
        panel((x, y, 0.6), (1.5, 0.0, 0.0), (0.0, 1.5, 0.0), (0.7, 0.3, 0.2), side=24)
        for x in (-6.0, -1.0, 4.0)
        for y in (-7.0, 2.0)
    ]
    tree = ball((2.0, -3.0, 1.0), 0.8, 0.1, (0.2, 0.5, 0.2), 400)
    land = panel((-10.0, -10.0, 0.0), (20.0, 0.0, 0.0), (0.0, 20.0, 0.0), side=60)
    means = land.means.copy()
    means[np.abs(means[:, 0]) < 0.9, 2] -= np.float32(ditch)
    return joined(Gaussians(means, land.quats, land.scales, land.opacities, land.sh), *houses, tree)


def chair() -> Gaussians:
    """Return a chair whose z is up and whose back, at y = 0, has more surface than all else."""
    legs = [
        panel((x, y, 0.0), (0.08, 0.0, 0.0), (0.0, 0.0, 0.9), side=20) for x in (0.0, 0.92) for y in (0.0, 0.9)
    ]
    back = panel((0.0, 0.0, 0.9), (1.0, 0.0, 0.0), (0.0, 0.0, 1.1), side=50)
    return joined(back, panel((0.0, 0.0, 0.9), (1.0, 0.0, 0.0), (0.0, 0.9, 0.0), side=30), *legs)


def room(x: float = 6.0, y: float = 6.0, z: float = 2.5, *, floor: bool = True) -> Gaussians:
    """Return a closed box with a floor and a ceiling across z, or only walls."""
    walls = [
        *(panel((0, at, 0), (x, 0, 0), (0, 0, z), (0.8, 0.3, 0.3)) for at in (0, y)),
        *(panel((at, 0, 0), (0, y, 0), (0, 0, z), (0.3, 0.3, 0.8)) for at in (0, x)),
    ]
    levels = [panel((0, 0, height), (x, 0, 0), (0, y, 0)) for height in (0.0, z)] if floor else []
    return joined(*walls, *levels)


def guitar() -> Gaussians:
    """Return a body of radius 1 with a thin neck of five times that, upwards."""
    body = ball((0.0, 0.0, 0.0), 1.0, 0.08, (0.6, 0.4, 0.2), 3000)
    places = np.linspace(1.0, 5.0, 250)
    return joined(body, colored(np.stack([0 * places, -places, 0 * places], axis=1), (0.06,) * 3, (0.3, 0.2, 0.1)))


def relief() -> Gaussians:
    """Return a checkered picture that faces +z, and grey paper behind it at -z."""
    paper = panel((-1.0, -1.0, -0.1), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0), (0.4, 0.4, 0.4))
    return joined(paper, panel((-1.0, -1.0, 0.0), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0), (0.9, 0.9, 0.9), checks=8))


def mug(up: float = -1.0) -> Gaussians:
    """Return a thing that is lighter and finer above than below, ``up`` along y, with nothing below it."""
    heights = np.linspace(-1.0, 1.0, 9)
    rings = [
        panel(
            (np.cos(turn), up * low, np.sin(turn)),
            (np.cos(turn + 0.35) - np.cos(turn), 0.0, np.sin(turn + 0.35) - np.sin(turn)),
            (0.0, 0.25 * up, 0.0),
            (0.5 + 0.4 * low,) * 3,
            side=round(5 + 3 * low),
        )
        for low in heights[:-1]
        for turn in np.arange(0.0, 2.0 * np.pi, 0.35)
    ]
    lid = panel((-0.7, up, -0.7), (1.4, 0.0, 0.0), (0.0, 0.0, 1.4), (0.95, 0.95, 0.95), side=30)
    return joined(*rings, lid)


def ring_of_cameras(
    center: Point, radius: float, up: Point, *, outwards: bool = False, count: int = 12
) -> list[Camera]:
    """Return cameras on a level circle, held level, that look at its middle or away from it."""
    axis = np.asarray(up, np.float64) / np.linalg.norm(up)
    ahead = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    ahead /= np.linalg.norm(ahead)
    cameras = []
    for turn in 2.0 * np.pi * np.arange(count) / count:
        away = radius * (np.cos(turn) * ahead + np.sin(turn) * np.cross(axis, ahead))
        eye = np.asarray(center) + away
        target = eye + away if outwards else np.asarray(center)
        cameras.append(Camera.look_at(eye, target, axis, width=300, height=200, fov_y=50.0))
    return cameras
