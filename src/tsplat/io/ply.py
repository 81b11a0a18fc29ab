"""PLY as 3D Gaussian splatting writes it: logit opacities, log scales, channel-major colours.

Source: Kerbl et al. 2023, *3D Gaussian Splatting*, whose training code set the names of the columns.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np

from tsplat.errors import LoadError, LoadWarning
from tsplat.importance import most_important
from tsplat.io import compressed_ply
from tsplat.io.activation import Activation
from tsplat.io.arrays import Arrays
from tsplat.io.finish import finish, warn_dropped
from tsplat.io.options import LoadOptions
from tsplat.io.ply_colors import to_harmonics
from tsplat.io.ply_columns import NAMES, find_columns, rest_names
from tsplat.io.ply_comments import antialias_comments, is_antialiased
from tsplat.io.ply_decode import Decoder, Piece
from tsplat.io.ply_halves import with_halves
from tsplat.io.ply_header import MAGIC, Header, read_header
from tsplat.io.ply_rows import find_rows, read_rows
from tsplat.io.points import make_balls
from tsplat.scene import Gaussians

OPACITY_EPS = 1e-7
"""Opacities are kept this far from 0 and 1 in a file, where their logits would be infinite."""

WRITE_ROWS = 4096


def matches(head: bytes) -> bool:
    """Tell whether a file that begins with these bytes is a PLY."""
    return head.startswith(MAGIC)


def read(path: Path, options: LoadOptions, progress: Callable[[float], None]) -> Gaussians:
    """Read a PLY of splats, ordinary or compressed, or of points; see `tsplat.io.load` for the parameters.

    Raises
    ------
    LoadError
        It is a PLY, but of a kind that is not read here, or none of its splats can be drawn.
    CorruptFileError
        Header and contents contradict each other, or the file ends early.

    Warns
    -----
    LoadWarning
        It holds points, splats that move, or halves in columns of integers; or splats were mended or left out.
    """
    with path.open("rb") as file:
        header = read_header(file, path)
        if compressed_ply.is_compressed(header):
            arrays, good = compressed_ply.read_arrays(file, path, header, progress)
            antialiased = is_antialiased(header.comments)
            return finish(path, *arrays, good=good, max_splats=options.max_splats, antialiased=antialiased)
        vertex = header.element("vertex")
        if vertex is None:
            raise LoadError(path, "holds no element 'vertex', so it is no splat scene; choose another file")
        columns = find_columns(path, vertex)
        start = find_rows(file, path, header, vertex)
        meant = with_halves(file, path, header, vertex, columns, start)

        def pieces(begin: float, end: float) -> Iterator[Piece]:
            done = 0
            for rows in read_rows(file, path, header, meant, start):
                yield slice(done, done + len(rows)), rows
                done += len(rows)
                progress(begin + (end - begin) * done / vertex.count)

        # How large points are, only all of them together say.
        limit = None if columns.are_points else options.max_splats
        arrays = _decoded(path, Decoder(columns, Activation(options)), limit, vertex.count, pieces)
    code = vertex.properties[columns.arrays["sh"][0]].code if len(columns.arrays["sh"]) else ""
    to_harmonics(arrays.sh[:, 0], columns.colors, code)
    balls = make_balls(path, arrays, _kind(header)) if columns.are_points else None
    if columns.moving:
        names = ", ".join(columns.moving[:3])
        problem = f"its columns {names} say how splats move in time; they are drawn without, all at once"
        warnings.warn(f"{path}: {problem}", LoadWarning, stacklevel=3)
    antialiased = is_antialiased(header.comments) or columns.filter_3d is not None
    return finish(path, *arrays, good=balls, max_splats=options.max_splats, antialiased=antialiased)


def _decoded(
    path: Path, decoder: Decoder, limit: int | None, count: int, pieces: Callable[[float, float], Iterator[Piece]]
) -> Arrays:
    """Return all splats, or so many of the weightiest."""
    if limit is None or limit >= count:
        arrays = decoder.gather(pieces(0.0, 1.0), count)
        decoder.activation.warn(path, count, stacklevel=5)
        return arrays
    scores = decoder.score(pieces(0.0, 0.5), count)
    decoder.activation.warn(path, count, stacklevel=5)  # what is picked is counted already
    if scores.max() < 0.0:  # none of them can be drawn: `finish` says why
        return decoder.gather(pieces(0.5, 1.0), count)
    warn_dropped(path, int(np.count_nonzero(scores < 0.0)), count, stacklevel=5)
    return decoder.pick(pieces(0.5, 1.0), most_important(scores, limit))


def _kind(header: Header) -> str:
    faces = header.element("face")
    return "a mesh" if faces and faces.count else "a point cloud"


def write(file: BinaryIO, gaussians: Gaussians) -> None:
    """Write a little-endian splat PLY, columns in the order of the original training code.

    Opacities of 0 and 1 and scales of 0 become the nearest that a file can hold.
    """
    k = gaussians.sh.shape[1]
    rest = sorted(rest_names(k), key=lambda name: int(name.rpartition("_")[2]))
    normals = ["nx", "ny", "nz"]
    names = [*NAMES["means"], *normals, *NAMES["sh"], *rest]
    names += [*NAMES["opacities"], *NAMES["scales"], *NAMES["quats"]]
    lines = ["ply", "format binary_little_endian 1.0", *antialias_comments(gaussians)]
    lines += [f"element vertex {len(gaussians)}"]
    lines += [f"property float {name}" for name in names]
    file.write("\n".join([*lines, "end_header", ""]).encode("ascii"))
    for first in range(0, len(gaussians), WRITE_ROWS):
        part = slice(first, first + WRITE_ROWS)
        sh = gaussians.sh[part]
        opacities = np.clip(gaussians.opacities[part, None].astype(np.float64), OPACITY_EPS, 1.0 - OPACITY_EPS)
        columns = (
            gaussians.means[part],
            np.zeros_like(gaussians.means[part]),
            sh[:, 0],
            sh[:, 1:].transpose(0, 2, 1).reshape(len(sh), -1),
            np.log(opacities / (1.0 - opacities)),
            np.log(np.maximum(gaussians.scales[part], np.finfo(np.float32).tiny)),
            gaussians.quats[part],
        )
        file.write(np.concatenate(columns, axis=1).astype("<f4").tobytes())
