"""The file formats, one line each: add a module with `matches`, `read` and maybe `write`, then a line here."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Protocol

from tsplat.io import (
    colmap_points,
    compressed_ply_write,
    gltf,
    gltf_write,
    gsplat_png,
    ksplat,
    npz,
    ply,
    sog,
    sog_write,
    splat,
    spz,
)
from tsplat.io import tsplat_file as tsplat
from tsplat.io.losses import lacks
from tsplat.io.options import LoadOptions
from tsplat.scene import Gaussians


class Reader(Protocol):
    """Reads a scene; raises `LoadError`, and calls ``progress`` with the fraction done."""

    def __call__(self, path: Path, options: LoadOptions, progress: Callable[[float], None], /) -> Gaussians: ...


@dataclass(frozen=True, slots=True)
class Format:
    """How one kind of file is recognised, read and written.

    Attributes
    ----------
    name : str
        For people.
    suffixes : tuple of str
        Lower case, with the dot; they decide where the first bytes do not.
    matches : callable
        Tells from the first `HEAD_BYTES` bytes whether a file is of this kind.
    read : Reader
        Reads a scene.
    write : callable, optional
        Writes a scene to a binary file that is open for writing; what the format cannot hold becomes the nearest.
        Returns what of its range that changes, see `tsplat.io.losses`.
    levels : bool
        Whether there may be levels of detail.
    sh_degree : int
        The highest that is written.
    keeps : set of str
        What is written beside the splats, see `tsplat.io.losses.lacks`.
    is_text : bool
        Whether it is plain text: rows of numbers, which its name alone may tell from others.
    """

    name: str
    suffixes: tuple[str, ...]
    matches: Callable[[bytes], bool]
    read: Reader
    write: Callable[[BinaryIO, Gaussians], list[str]] | None = None
    levels: bool = False
    sh_degree: int = 3
    keeps: frozenset[str] = frozenset()
    is_text: bool = False

    def is_numbers(self, head: bytes) -> bool:
        """Tell whether it is plain text, and a file begins as such with a number."""
        return self.is_text and re.match(rb"\s*[-+.\d]*\d\s", head) is not None

    def losses(self, gaussians: Gaussians) -> list[str]:
        """Return what the format has no place for."""
        return lacks(gaussians, self.sh_degree, self.keeps)


HEAD_BYTES = 1024
"""How much of a file `Format.matches` gets to see."""

SAYS_ALL = frozenset({"origin", "up", "antialiased", "comments", "extra"})
SAYS_TRAINING = frozenset({"antialiased"})

FORMATS = (
    Format("PLY", (".ply",), ply.matches, ply.read, ply.write, sh_degree=4, keeps=SAYS_ALL),
    Format(
        "compressed PLY",
        (".compressed.ply",),
        ply.matches,
        ply.read,
        compressed_ply_write.write,
        keeps=SAYS_ALL - {"origin", "extra"},
    ),
    Format(
        "COLMAP points",
        ("points3d.txt",),
        colmap_points.matches_text,
        colmap_points.read_text,
        is_text=True,
    ),
    Format("COLMAP points", ("points3d.bin",), colmap_points.matches_binary, colmap_points.read_binary),
    Format("NumPy", (".npz",), npz.matches, npz.read),
    Format("SOG", (".sog",), sog.matches, sog.read, sog_write.write, levels=True, keeps=SAYS_TRAINING),
    Format("SOG", (".json",), sog.matches, sog.read, levels=True),
    Format("gsplat PNG", (), lambda _: False, gsplat_png.read),
    Format("GLB", (".glb",), gltf.matches_glb, gltf.read, gltf_write.write_glb, keeps=frozenset({"origin"})),
    Format("glTF", (".gltf",), gltf.matches_json, gltf.read, gltf_write.write_gltf, keeps=frozenset({"origin"})),
    Format("SPZ", (".spz",), spz.matches, spz.read, spz.write, keeps=SAYS_TRAINING),
    Format("ksplat", (".ksplat",), ksplat.matches, ksplat.read),
    Format("tsplat", (".tsplat",), tsplat.matches, tsplat.read),
    Format("splat", (".splat",), splat.matches, splat.read, splat.write, sh_degree=0),
)


def fitting_formats(head: bytes) -> list[Format]:
    """Return the formats whose files may begin with these bytes."""
    return [known for known in FORMATS if known.matches(head)]


def find_format(head: bytes, name: str) -> Format | None:
    """Return the format of a file, or None.

    Its first bytes decide; where they fit several formats or none, the longest ending of its name does.
    """
    fitting = fitting_formats(head)
    ends = [
        (len(suffix), known)
        for known in fitting or FORMATS
        for suffix in known.suffixes
        if name.lower().endswith(suffix)
    ]
    return max(ends, key=lambda end: end[0], default=(0, fitting[0] if fitting else None))[1]
