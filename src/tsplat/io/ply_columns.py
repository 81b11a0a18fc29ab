"""Which columns of a PLY's vertices make up each array of `Gaussians`, or why there are none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from tsplat.errors import CorruptFileError, LoadError, shown
from tsplat.io.ply_header import Element
from tsplat.scene import SH_COEFFICIENTS

Columns = dict[str, npt.NDArray[np.intp]]

NAMES = {
    "means": ("x", "y", "z"),
    "quats": ("rot_0", "rot_1", "rot_2", "rot_3"),
    "scales": ("scale_0", "scale_1", "scale_2"),
    "opacities": ("opacity",),
    "sh": ("f_dc_0", "f_dc_1", "f_dc_2"),
}
"""Columns that every splat has, by array; ``f_rest_*`` adds to ``sh``."""

REST_COUNTS = tuple(3 * (k - 1) for k in SH_COEFFICIENTS)


def find_columns(path: Path, vertex: Element) -> Columns:
    """Return the indices of the columns of each array, in the order of its values.

    Parameters
    ----------
    path : Path
        The file, for errors.
    vertex : Element
        Its element of splats.

    Returns
    -------
    dict of str to ndarray of intp
        ``means`` [3], ``quats`` [4], ``scales`` [3], ``opacities`` [1] and ``sh`` [K * 3], all channels of
        a coefficient side by side.

    Raises
    ------
    LoadError
        The vertices are compressed, have lists, or are no splats.
    CorruptFileError
        Some columns of a splat are missing.
    """
    _refuse_other_kinds(path, vertex)
    index = {name: column for column, name in enumerate(vertex.names)}
    missing = [name for names in NAMES.values() for name in names if name not in index]
    if missing:
        raise CorruptFileError(path, f"vertex: properties missing: {', '.join(missing)}; export the scene again")
    columns = {field: [index[name] for name in names] for field, names in NAMES.items()}
    columns["sh"] += [index[name] for name in _rest_names(path, vertex)]
    return {field: np.array(chosen, np.intp) for field, chosen in columns.items()}


def rest_names(k: int) -> list[str]:
    """Return the names of the K - 1 higher coefficients, all channels of a coefficient side by side.

    The file counts all red coefficients, then green, then blue.
    """
    return [f"f_rest_{channel * (k - 1) + i}" for i in range(k - 1) for channel in range(3)]


def _rest_names(path: Path, vertex: Element) -> list[str]:
    found = {name for name in vertex.names if name.startswith("f_rest_")}
    if len(found) not in REST_COUNTS:
        expected = ", ".join(map(str, REST_COUNTS))
        problem = f"vertex: {len(found)} properties f_rest_*, expected {expected} (SH degree 0 to 4)"
        raise CorruptFileError(path, f"{problem}; export the scene again")
    names = rest_names(len(found) // 3 + 1)
    missing = sorted(set(names) - found)
    if missing:
        raise CorruptFileError(path, f"vertex: properties missing: {', '.join(missing)}; export the scene again")
    return names


def _refuse_other_kinds(path: Path, vertex: Element) -> None:
    if "packed_position" in vertex.names:
        problem = "has packed_position, but no element 'chunk' that says what it is packed in"
        raise LoadError(path, f"{problem}; export the scene again")
    lists = [prop.name for prop in vertex.properties if prop.length_code]
    if lists:
        raise LoadError(path, f"vertex: property {shown(lists[0], 40)} is a list; export the scene without it")
    absent = [field for field in ("scales", "quats", "opacities") if not set(NAMES[field]) & set(vertex.names)]
    if len(absent) == 3:
        problem = "is a point cloud or a mesh, not a splat scene: its vertices lack opacity, scale_* and rot_*"
        raise LoadError(path, f"{problem}; open the PLY that splat training wrote")
