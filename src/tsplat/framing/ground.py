"""A ground, or a floor and a ceiling: level surface that says which way is up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tsplat.camera import Vector
from tsplat.framing.sample import Mask, quantiles
from tsplat.framing.surface import Surface

F64 = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]

LEVEL_COSINE = 0.9
"""A surface is level within 26 degrees."""

SLAB = 0.1
"""A ground is as thick as this, in heights of the scene, to either side of its middle."""

BINS, SLAB_BINS = 48, 8
"""Heights are told apart in so many bins from one slab below the scene to one above it; a slab takes eight."""

LOWEST, BELOW, ABOVE = 0.25, 0.04, 0.02
"""A ground lies in the lowest quarter of the scene and has a twenty-fifth of what is solid below it; something
stands on it, else it might as well be a wall."""

LAND, LAND_LOWEST, LAND_BELOW = 0.40, 0.35, 0.25
"""Where two fifths of all flat surface are at one height, as in scans from the air, it may be so much higher, and
have below it a quarter of what is above: land has ditches."""

LEAST, COVER, ALL = 0.10, 0.66, 0.85
"""It is a tenth of all flat surface, and covers two thirds of the scene as seen from above, which itself covers
its square. Grounds of real scenes have 0.15 to 0.62 of the surface and 0.72 to 1 of the cover. The back of a
chair, a floor in all else, covers as much, but the chair then leaves a quarter of its square empty."""

MUCH = 0.20
"""Or it is a fifth of all flat surface, and what is at its height, level or not, covers nearly all: a rug."""

SURE = 0.25
"""Share of the surface from which on a ground is no doubt one."""

CELLS = 8
"""Cells to a side of the scene as seen from above."""

FILLED, TOUCHED = 0.1, 0.02
"""A cell is filled from this share of what those cells hold that are filled best; it is not empty from that on."""

ROOM_COVER, ROOM_LEAD, ROOM_WALLS = 0.6, 1.3, 0.1
"""A room has a floor or a ceiling that covers as much; 1.3 times as much level surface as walls to either
side; and walls: what is flat and faces one way only is a relief, a picture, a plank."""


@dataclass(frozen=True, slots=True)
class Level:
    """The level surface at that height where most of it is.

    Attributes
    ----------
    share : float
        Of all flat surface, at any height.
    here : float
        Of that, what lies at this height.
    height : float
        0 at the bottom of the scene, 1 at its top.
    below, above : float
        Shares of what is solid below it and above.
    cover : float
        Share of the scene, seen from above, that the level surface at this height covers.
    slab : float
        Share that is covered by what is solid at this height.
    all : float
        Share that is covered at any height.
    """

    share: float
    here: float
    height: float
    below: float
    above: float
    cover: float
    slab: float
    all: float

    @property
    def amount(self) -> float:
        """Share of all flat surface that is level and at this height."""
        return self.share * self.here

    @property
    def is_ground(self) -> bool:
        """Whether it lies under everything, and everywhere."""
        lowest, below = LOWEST, BELOW
        if self.amount > LAND:
            lowest, below = LAND_LOWEST, max(BELOW, LAND_BELOW * self.above)
        if self.height > lowest or self.below > below or self.above < ABOVE:
            return False
        if self.amount > MUCH and self.slab > ALL:
            return True
        return self.amount > LEAST and self.cover > COVER and self.all > ALL


class Levels:
    """The level surfaces of a scene that has some surface, for each axis that may be up.

    Parameters
    ----------
    seen : Surface
        The scene's.
    """

    def __init__(self, seen: Surface) -> None:
        self._seen = seen
        self._spans = [quantiles(places, seen.solid, (0.01, 0.02, 0.98, 0.99)) for places in seen.means.T]
        self._level = [np.where(np.abs(each) > LEVEL_COSINE, seen.flat, 0.0) for each in seen.normals.T]

    def share(self, axis: int) -> float:
        """Return the share of all flat surface that is level where this axis is up."""
        return float(self._level[axis].sum() / self._seen.flat.sum())

    def at(self, up: Vector) -> Level:
        """Return the level surface at the height where most of it is."""
        axis = axis_of(up)
        low, _, _, high = self._spans[axis]
        heights = (self._seen.means[:, axis] - low) / max(high - low, 1e-30)
        heights = heights if up[axis] > 0.0 else 1.0 - heights
        level, solid = self._level[axis], self._seen.solid
        edges = np.linspace(-SLAB, 1.0 + SLAB, BINS + 1)
        sums = np.cumsum([0.0, *np.histogram(heights, edges, weights=level)[0]])
        first = int(np.argmax(sums[SLAB_BINS:] - sums[:-SLAB_BINS]))
        height = float(0.5 * (edges[first] + edges[first + SLAB_BINS]))
        here = np.abs(heights - height) < SLAB
        cells = self._cells(axis)
        return Level(
            share=self.share(axis),
            here=float(level[here].sum() / max(level.sum(), 1e-300)),
            height=height,
            below=float(solid[heights < height - SLAB].sum() / solid.sum()),
            above=float(solid[heights > height + SLAB].sum() / solid.sum()),
            cover=_cover(cells, np.where(here, level, 0.0), FILLED),
            slab=_cover(cells, np.where(here, solid, 0.0), FILLED),
            all=_cover(cells, solid, TOUCHED),
        )

    def _cells(self, axis: int) -> Index:
        """Return in which cell each splat lies, seen along an axis; in one after the last where it is outside."""
        cells = np.zeros(len(self._seen.means), np.int64)
        outside: Mask = np.zeros(len(cells), np.bool_)
        for side in {0, 1, 2} - {axis}:
            _, low, high, _ = self._spans[side]
            column = np.floor(CELLS * (self._seen.means[:, side] - low) / max(high - low, 1e-30))
            outside |= (column < 0) | (column >= CELLS)
            cells = CELLS * cells + np.clip(column, 0, CELLS - 1).astype(np.int64)
        return np.where(outside, CELLS * CELLS, cells)


def ground(levels: Levels, ups: Sequence[Vector]) -> tuple[Vector, bool] | None:
    """Return which of these directions has a ground, and whether that is sure; the first of equals.

    Where floor and ceiling are alike, neither says anything.
    """
    found = {up: each for up in ups if levels.share(axis_of(up)) > LEAST and (each := levels.at(up)).is_ground}
    found = {up: each for up, each in found.items() if _opposite(up) not in found}
    if not found:
        return None
    best = max(found, key=lambda up: found[up].amount)
    return best, found[best].amount > SURE


def room(levels: Levels, up: Vector) -> bool:
    """Tell whether there are floor or ceiling, and walls, if this is up or down."""
    axis = axis_of(up)
    walls = [levels.share(each) for each in range(3) if each != axis]
    if min(walls) < ROOM_WALLS or levels.share(axis) < ROOM_LEAD * max(walls):
        return False
    return levels.at(up).cover > ROOM_COVER


def axis_of(up: Vector) -> int:
    """Return the axis that a direction lies along: 0, 1 or 2."""
    return max(range(3), key=lambda axis: abs(up[axis]))


def _cover(cells: Index, amounts: F64, share: float) -> float:
    """Return the share of cells that hold a share of what the fullest quarter of them holds."""
    held = np.bincount(cells, amounts, minlength=CELLS * CELLS + 1)[: CELLS * CELLS]
    most = np.sort(held)[-CELLS * CELLS // 4 :].mean()
    return float(np.mean(held > share * most)) if most > 0.0 else 0.0


def _opposite(up: Vector) -> Vector:
    x, y, z = up
    return 0.0 - x, 0.0 - y, 0.0 - z
