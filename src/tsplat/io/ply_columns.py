"""Which columns of a PLY's vertices make up each array of `Gaussians`, or why there are none."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from tsplat.errors import CorruptFileError, LoadError, shown
from tsplat.io.ply_header import Element
from tsplat.scene import SH_COEFFICIENTS

Index = npt.NDArray[np.intp]
Colors = Literal["harmonics", "rgb", "intensity", "none"]

NAMES = {
    "means": ("x", "y", "z"),
    "quats": ("rot_0", "rot_1", "rot_2", "rot_3"),
    "scales": ("scale_0", "scale_1", "scale_2"),
    "opacities": ("opacity",),
    "sh": ("f_dc_0", "f_dc_1", "f_dc_2"),
}
"""Columns that every splat has, by array; ``f_rest_*`` adds to ``sh``."""

ALL_NAMES = frozenset(name for names in NAMES.values() for name in names)

RGB = (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue"))
"""Colours of points, and of splats by nerfstudio's ``--ply-color-mode rgb``."""

INTENSITIES = ("intensity", "reflectance", "reflectivity")
"""What a laser scanner has in place of a colour."""

FILTER = "filter_3d"
"""Mip-Splatting's, by which scales and opacities are to be widened before they are drawn."""

REST_COUNTS = tuple(3 * (k - 1) for k in SH_COEFFICIENTS)

LONGEST_NAME = 40
"""Of columns that are shown in place of missing ones."""

_RENAMED = re.compile(r"^(scalar_|scal_)+")
"""What CloudCompare puts before the names of columns that it does not know."""

_MOVING = re.compile(r"t|trbf_(center|scale)|motion_\d+|omega_\d+|(scale|scaling|rot|f)_t(_\d+)?")
"""Columns of splats that move, as in Spacetime Gaussians and 4DGS."""


@dataclass(frozen=True, eq=False, slots=True)
class Columns:
    """Which columns hold what.

    Attributes
    ----------
    arrays : dict of str to ndarray of intp
        ``means`` [3], ``quats`` [4], ``scales`` [3] or, of flat splats, [2], ``opacities`` [1] and ``sh`` [K * 3],
        all channels of a coefficient side by side. Points have no quats, scales and opacities, and ``sh`` only
        where ``colors`` says so.
    colors : {"harmonics", "rgb", "intensity", "none"}
        What is in the first three columns of ``sh``.
    filter_3d : int, optional
        Mip-Splatting's filter.
    moving : tuple of str
        Names of columns that say how splats move, which nothing here looks at.
    """

    arrays: dict[str, Index]
    colors: Colors = "harmonics"
    filter_3d: int | None = None
    moving: tuple[str, ...] = ()

    @property
    def are_points(self) -> bool:
        """Whether they are points, which have no sizes of their own."""
        return "scales" not in self.arrays

    @property
    def used(self) -> set[int]:
        """All columns that are read."""
        filters = set() if self.filter_3d is None else {self.filter_3d}
        return filters.union(*(map(int, columns) for columns in self.arrays.values()))

    @property
    def k(self) -> int:
        """How many coefficients a colour has."""
        return max(1, len(self.arrays["sh"]) // 3)


def find_columns(path: Path, vertex: Element) -> Columns:
    """Return which columns hold what.

    Names may be in capitals, and as CloudCompare writes them: ``scalar_opacity``.

    Parameters
    ----------
    path : Path
        The file, for errors.
    vertex : Element
        Its element of splats or points.

    Raises
    ------
    LoadError
        The vertices are compressed, have lists, or are neither splats nor points.
    CorruptFileError
        Some columns of a splat are missing.
    """
    index = _by_meaning(vertex.names)
    _refuse_other_kinds(path, vertex, index)
    if not any(name in index for field in ("scales", "quats", "opacities") for name in NAMES[field]):
        return _points(path, vertex, index)
    scales = _scale_names(index)
    first, colors = _color_names(index)
    wanted = {**NAMES, "scales": scales, "sh": first or NAMES["sh"]}
    _require(path, vertex, index, (name for names in wanted.values() for name in names))
    wanted["sh"] += tuple(_rest_names(path, vertex, index))
    return Columns(
        {field: np.array([index[name] for name in names], np.intp) for field, names in wanted.items()},
        colors if first else "harmonics",
        index.get(FILTER),
        tuple(name for name in index if _MOVING.fullmatch(name)),
    )


def rest_names(k: int) -> list[str]:
    """Return the names of the K - 1 higher coefficients, all channels of a coefficient side by side.

    The file counts all red coefficients, then green, then blue.
    """
    return [f"f_rest_{channel * (k - 1) + i}" for i in range(k - 1) for channel in range(3)]


def _by_meaning(names: tuple[str, ...]) -> dict[str, int]:
    """Return the columns by what their names mean; a name as it is meant comes before one that was changed."""
    meanings = [_RENAMED.sub("", name.lower()) for name in names]
    index = {name: column for column, name in enumerate(names) if name == meanings[column]}
    for column, meaning in enumerate(meanings):
        index.setdefault(meaning, column)
    return index


def _points(path: Path, vertex: Element, index: dict[str, int]) -> Columns:
    _require(path, vertex, index, NAMES["means"])
    names, colors = _color_names(index)
    if not names:
        names = next(((name,) * 3 for name in INTENSITIES if name in index), ())
        colors = "intensity" if names else "none"
    arrays = {
        field: np.array([index[name] for name in found], np.intp)
        for field, found in (("means", NAMES["means"]), ("sh", names))
    }
    return Columns(arrays, colors)


def _scale_names(index: dict[str, int]) -> tuple[str, ...]:
    """Return the names of the scales: 2DGS writes two, for splats without a thickness; balls need one."""
    names = tuple(name for name in NAMES["scales"] if name in index)
    if names == NAMES["scales"][:2]:
        return names
    return 3 * names if names == NAMES["scales"][:1] else NAMES["scales"]


def _color_names(index: dict[str, int]) -> tuple[tuple[str, ...], Colors]:
    if all(name in index for name in NAMES["sh"]):
        return NAMES["sh"], "harmonics"
    return next(((names, "rgb") for names in RGB if all(name in index for name in names)), ((), "none"))


def _rest_names(path: Path, vertex: Element, index: dict[str, int]) -> list[str]:
    found = {name for name in index if name.startswith("f_rest_")}
    if len(found) not in REST_COUNTS:
        expected = ", ".join(map(str, REST_COUNTS))
        problem = f"vertex: {len(found)} properties f_rest_*, expected {expected} (SH degree 0 to 4)"
        raise CorruptFileError(path, f"{problem}; export the scene again")
    names = rest_names(len(found) // 3 + 1)
    _require(path, vertex, index, sorted(names))
    return names


def _require(path: Path, vertex: Element, index: dict[str, int], names: Iterable[str]) -> None:
    missing = list(dict.fromkeys(name for name in names if name not in index))
    if not missing:
        return
    others = [name for name in vertex.names if len(name) <= LONGEST_NAME and name not in ALL_NAMES]
    near = dict.fromkeys(close for name in missing for close in get_close_matches(name, others, 1, 0.5))
    there = f", but there are {', '.join(map(ascii, near))}" if near else ""
    problem = f"vertex: properties missing: {', '.join(missing)}{there}"
    raise CorruptFileError(path, f"{problem}; export the scene again")


def _refuse_other_kinds(path: Path, vertex: Element, index: dict[str, int]) -> None:
    if "packed_position" in index:
        problem = "has packed_position, but no element 'chunk' that says what it is packed in"
        raise LoadError(path, f"{problem}; export the scene again")
    lists = [prop.name for prop in vertex.properties if prop.length_code]
    if lists:
        raise LoadError(path, f"vertex: property {shown(lists[0], 40)} is a list; export the scene without it")
    if any(name.startswith(("f_anchor_feat", "f_offset_")) for name in index):
        problem = "holds anchors of Scaffold-GS or one of its kind (f_anchor_feat_*), not splats"
        step = "only its trained networks make splats of them: let its own code render them"
        raise LoadError(path, f"{problem}; {step}, or train with 3DGS, gsplat or splatfacto")
