"""glTF, as .glb or .gltf, with splats of KHR_gaussian_splatting: activated values, ``xyzw``, +Y up.

Source: KHR_gaussian_splatting of the KhronosGroup/glTF repository. Its world is turned by half a turn about z, as
splat-transform does between glTF and PLY, so that scenes stand upright; the matrices of the nodes come before.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tsplat.errors import LoadError, LoadWarning
from tsplat.io.arrays import Arrays
from tsplat.io.finish import finish
from tsplat.io.gltf_document import MAGIC, Document, open_document
from tsplat.io.gltf_nodes import placed_meshes
from tsplat.io.gltf_primitives import EXTENSION, find_primitives
from tsplat.io.gltf_splats import Primitive
from tsplat.io.gltf_transform import move
from tsplat.io.options import LoadOptions
from tsplat.origin import SAMPLE, find_origin
from tsplat.scene import Gaussians, Vector

HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0])

UP = (0.0, -1.0, 0.0)
"""+Y of the format, after that turn."""

SPLATS_A_BYTE = 16
"""Nodes may show the same splats again and again; so many more than there are bytes are a trap."""

SPARE_SPLATS = 1 << 16

F64 = npt.NDArray[np.float64]
Placed = tuple[Primitive, F64]


def matches_glb(head: bytes) -> bool:
    """Tell whether a file that begins with these bytes is a GLB."""
    return head.startswith(MAGIC)


def matches_json(head: bytes) -> bool:
    """Tell whether a file that begins with these bytes is a JSON object; the suffix has to tell which."""
    return head.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"{")


def read(path: Path, options: LoadOptions, progress: Callable[[float], None]) -> Gaussians:
    """Read the splats that the scene of a glTF shows; see `tsplat.io.load` for the parameters.

    Raises
    ------
    CorruptFileError
        Something that the file names is not there, or not what it should be.
    LoadError
        It shows no splats, or is packed in a way that is not known.

    Warns
    -----
    LoadWarning
        A kernel, a projection or colours are not as they are drawn here, or splats were mended or left out.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # what that makes is dropped by finish
        placed, problems = _find(open_document(path))
        splats, origin = _read_all(placed, progress)
        outside = (splats.opacities < 0.0) | (splats.opacities > 1.0)
        np.clip(splats.opacities, 0.0, 1.0, out=splats.opacities)
    if outside.any():
        problems.add(f"{outside.sum()} of {len(outside)} opacities lay outside 0 to 1 and were clamped")
    for problem in sorted(problems):
        warnings.warn(f"{path}: {problem}", LoadWarning, stacklevel=3)
    antialiased = all(primitive.antialiased for primitive, _ in placed)
    return finish(path, *splats, max_splats=options.max_splats, antialiased=antialiased, up=UP, origin=origin)


def _find(document: Document) -> tuple[list[Placed], set[str]]:
    placed: list[Placed] = []
    problems = set[str]()
    known: dict[str, list[Primitive]] = {}
    for mesh, matrix in placed_meshes(document):
        if mesh.where not in known:
            known[mesh.where], unusual = find_primitives(document, mesh)
            problems |= unusual
        upright = HALF_TURN @ matrix
        placed += [(primitive, upright) for primitive in known[mesh.where]]
    if not placed:
        raise LoadError(document.path, f"shows no {EXTENSION}, so it is no splat scene; choose another file")
    count, there = sum(primitive.count for primitive, _ in placed), document.stored_bytes
    if count > SPARE_SPLATS + SPLATS_A_BYTE * there:
        problem = f"shows {count} splats, expected at most {SPLATS_A_BYTE} for each of {there} bytes; merge it"
        raise LoadError(document.path, problem)
    return placed, problems


def _read_all(placed: list[Placed], progress: Callable[[float], None]) -> tuple[Arrays, Vector | None]:
    count = sum(primitive.count for primitive, _ in placed)
    k = max(primitive.coefficients for primitive, _ in placed)
    splats = _allocate(count, k)
    parts: list[tuple[Arrays, F64]] = []
    first = 0
    for primitive, matrix in placed:
        part = Arrays(*(each[first : first + primitive.count] for each in splats))
        part.sh[:, primitive.coefficients :] = 0.0
        part = part._replace(sh=part.sh[:, : primitive.coefficients])

        def share(fraction: float, first: int = first, size: int = primitive.count) -> None:
            progress((first + fraction * size) / max(count, 1))

        primitive.fill(part, share)
        parts.append((part, matrix))
        first += primitive.count
    origin = _origin_of(parts, count)
    for part, matrix in parts:
        # In float64 before anything is rounded: a node may lie as far away as a map has it.
        move(part, matrix - _translation(origin) if origin else matrix)
    progress(1.0)
    return splats, origin


def _origin_of(parts: list[tuple[Arrays, F64]], count: int) -> Vector | None:
    step = 1 + count // SAMPLE
    some = [part.means[::step] @ matrix[:3, :3].T + matrix[:3, 3] for part, matrix in parts if len(part.means)]
    return find_origin(np.concatenate(some)) if some else None


def _translation(offset: Vector) -> F64:
    matrix = np.zeros((4, 4))
    matrix[:3, 3] = offset
    return matrix


def _allocate(count: int, k: int) -> Arrays:
    """Return arrays in one piece, so that what is too much for memory is refused at once."""
    shapes = ((count, 3), (count, 4), (count, 3), (count,), (count, k, 3))
    sizes = [math.prod(shape) for shape in shapes]
    pieces = np.split(np.empty(sum(sizes), np.float32), np.cumsum(sizes)[:-1])
    return Arrays(*(piece.reshape(shape) for piece, shape in zip(pieces, shapes, strict=True)))
