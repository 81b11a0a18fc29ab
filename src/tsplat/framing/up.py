"""Which way is up in a scene, by what that was told, and how surely."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from tsplat.camera import Vector
from tsplat.framing.bulk import Bulk, bounds
from tsplat.framing.cameras import up_of_cameras
from tsplat.framing.ground import Levels, ground, room
from tsplat.framing.sample import Sample
from tsplat.framing.surface import surface
from tsplat.framing.trim import trimmed_sample
from tsplat.framing.upside_down import TURNED, upside_down
from tsplat.scene import Gaussians
from tsplat.train_views import TrainViews

UP_DEFAULT: Vector = (0.0, -1.0, 0.0)
"""What COLMAP's cameras make of a scene, and SPZ and glTF by their specification once they are read."""

UP_Z: Vector = (0.0, 0.0, 1.0)

UPS: tuple[Vector, ...] = (
    UP_DEFAULT, (0.0, 1.0, 0.0), UP_Z, (0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0),
)  # fmt: skip
"""What may be up, the likely ones first: training, graphics programs, surveys."""

Cue = Literal["said", "file", "cameras", "ground", "room", "light and detail", "usual"]

MEANINGS: dict[Cue, str] = {
    "said": "as said",
    "file": "the file says so",
    "cameras": "as the training cameras were held",
    "ground": "there is a ground",
    "room": "there are floor, ceiling and walls",
    "light and detail": "light, weight and detail say so",
    "usual": "the usual, nothing in the scene tells; --up says it",
}

Sureness = Literal["sure", "likely", "weak"]


@dataclass(frozen=True, slots=True)
class Up:
    """Which way is up.

    Attributes
    ----------
    direction : tuple of 3 floats
        Unit vector.
    cue : str
        By what it was told, see `MEANINGS`.
    sureness : {"sure", "likely", "weak"}
        How surely.
    spz_frame : bool
        Whether the scene is an SPZ whose writer seems to have kept the axes of a PLY.
    """

    direction: Vector
    cue: Cue
    sureness: Sureness
    spz_frame: bool = False

    @property
    def text(self) -> str:
        """The guess in a few words."""
        return f"{axis_name(self.direction)}, {self.sureness}: {MEANINGS[self.cue]}"


def guess_up(gaussians: Gaussians, views: TrainViews | None = None, *, spz: bool = False) -> Up:
    """Return the direction that is up in the scene: -y unless something says otherwise.

    Parameters
    ----------
    gaussians : Gaussians
        Any scene.
    views : TrainViews, optional
        What the training cameras had in view, where that is known.
    spz : bool
        Whether the scene is an SPZ, of which many stand on their heads, read as its specification says.

    Notes
    -----
    What the file says comes first, unless there is a ground that is sure to lie elsewhere. Then come training
    cameras, as most people hold them level. A ground is level surface gathered at one height, below what is solid,
    and everywhere under it. docs/first-view.md has the rules, and how often they were right.
    """
    inner = trimmed_sample(gaussians)
    return guess_up_of(gaussians, inner, bounds(inner), views, spz=spz)


def guess_up_of(
    gaussians: Gaussians, inner: Sample, box: Bulk, views: TrainViews | None = None, *, spz: bool = False
) -> Up:
    """Do as `guess_up` with the trimmed sample and the bulk of the scene."""
    guess = _guess(gaussians, inner, box, views, spz=spz)
    said = gaussians.up
    # Comments outlive what they were written for; what scenes stand on does not lie.
    if said is None or (guess.cue == "ground" and guess.sureness == "sure" and guess.direction != said):
        return guess
    return Up(said, "file", "sure")


def _guess(gaussians: Gaussians, inner: Sample, box: Bulk, views: TrainViews | None, *, spz: bool) -> Up:
    if views and (held := up_of_cameras(views)):
        return Up(held, "cameras", "sure")
    if not len(inner.means):
        return Up(UP_DEFAULT, "usual", "weak")
    seen = surface(gaussians, box)
    if seen.flat.sum() > 0.0:
        levels = Levels(seen)
        if found := ground(levels, UPS):
            direction, sure = found
            return Up(direction, "ground", "sure" if sure else "likely", spz and direction == UPS[1])
        if spz and upside_down(seen, box, UP_DEFAULT) > TURNED:
            return Up(UPS[1], "light and detail", "likely", spz_frame=True)
        if room(levels, UP_Z):
            return Up(UP_Z, "room", "likely")
    return Up(UP_DEFAULT, "usual", "weak")


def axis_name(direction: Vector) -> str:
    """Return how `--up` takes a direction: -y, z, or three numbers."""
    for name, place in (("x", 0), ("y", 1), ("z", 2)):
        if abs(direction[place]) > 0.99999:
            return name if direction[place] > 0 else f"-{name}"
    return " ".join(f"{each:.3g}" for each in direction)
