"""PLY as 3D Gaussian splatting writes it: logit opacities, log scales, channel-major colours.

Source: Kerbl et al. 2023, *3D Gaussian Splatting*, whose training code set the names of the columns.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from tsplat.errors import LoadError, LoadWarning
from tsplat.extra import NORMALS, Extra
from tsplat.importance import most_important
from tsplat.io import compressed_ply
from tsplat.io.activation import Activation
from tsplat.io.arrays import Arrays
from tsplat.io.finish import finish, warn_dropped
from tsplat.io.options import LoadOptions
from tsplat.io.ply_colors import to_harmonics
from tsplat.io.ply_columns import NAMES, find_columns, rest_names
from tsplat.io.ply_comments import comment_lines, is_antialiased, said_up
from tsplat.io.ply_decode import Decoder, Piece
from tsplat.io.ply_extra import column_lines, read_extra, table_lines
from tsplat.io.ply_halves import with_halves
from tsplat.io.ply_header import MAGIC, Header, read_header
from tsplat.io.ply_origin import origin_of_rows
from tsplat.io.ply_rows import find_rows, read_rows
from tsplat.io.points import make_balls
from tsplat.scene import Gaussians

OPACITY_EPS = 1e-7
"""Opacities are kept this far from 0 and 1 in a file, where their logits would be infinite."""

WRITE_ROWS = 4096

PACKED_ELEMENTS = {"vertex", "chunk", "sh"}


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
        about: dict[str, Any] = {"antialiased": is_antialiased(header.comments), "up": said_up(header.comments)}
        if compressed_ply.is_compressed(header):
            arrays, good = compressed_ply.read_arrays(file, path, header, progress)
            if options.extra:
                about["extra"] = read_extra(file, path, header, compressed_ply.WORDS, PACKED_ELEMENTS)
            return finish(path, *arrays, good=good, max_splats=options.max_splats, **about)
        vertex = header.element("vertex")
        if vertex is None:
            raise LoadError(path, "holds no element 'vertex', so it is no splat scene; choose another file")
        columns = find_columns(path, vertex)
        start = find_rows(file, path, header, vertex)
        meant = with_halves(file, path, header, vertex, columns, start)
        axes = columns.arrays["means"].tolist()
        origin = origin_of_rows(file, header, meant, start, axes)
        shifts = dict(zip(axes, origin, strict=True)) if origin else None

        def pieces(begin: float, end: float) -> Iterator[Piece]:
            done = 0
            for rows in read_rows(file, path, header, meant, start, shifts):
                yield slice(done, done + len(rows)), rows
                done += len(rows)
                progress(begin + (end - begin) * done / vertex.count)

        # How large points are, only all of them together say.
        limit = None if columns.are_points else options.max_splats
        if options.extra:
            used = {vertex.names[column] for column in columns.used}
            about["extra"] = read_extra(file, path, header, used, {"vertex"})
            limit = None  # `finish` knows which ones are kept
        arrays = _decoded(path, Decoder(columns, Activation(options)), limit, vertex.count, pieces)
    code = vertex.properties[columns.arrays["sh"][0]].code if len(columns.arrays["sh"]) else ""
    to_harmonics(arrays.sh[:, 0], columns.colors, code)
    balls = make_balls(path, arrays, _kind(header)) if columns.are_points else None
    if columns.moving:
        names = ", ".join(columns.moving[:3])
        problem = f"its columns {names} say how splats move in time; they are drawn without, all at once"
        warnings.warn(f"{path}: {problem}", LoadWarning, stacklevel=3)
    about["antialiased"] |= columns.filter_3d is not None
    return finish(path, *arrays, good=balls, max_splats=options.max_splats, origin=origin, **about)


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


def write(file: BinaryIO, gaussians: Gaussians) -> list[str]:
    """Write a little-endian splat PLY, columns in the order of the original training code, then those of its own.

    Opacities of 0 and 1 and scales of 0 become the nearest that a file can hold. Far from the world's origin, x, y
    and z are doubles.
    """
    extra = gaussians.extra or Extra(np.zeros(len(gaussians), []))
    record = _record(gaussians, extra)
    lines = [b"ply", b"format binary_little_endian 1.0", *comment_lines(gaussians)]
    declared = [f"element vertex {len(gaussians)}", *column_lines(np.empty(0, record))]
    declared += [line for table in extra.tables for line in table_lines(table)]
    lines += [line.encode("ascii") for line in declared]
    file.write(b"\n".join([*lines, b"end_header", b""]))
    for first in range(0, len(gaussians), WRITE_ROWS):
        part = slice(first, first + WRITE_ROWS)
        rows = np.zeros(len(gaussians.means[part]), record)
        for name in extra.names:
            rows[name] = extra.columns[name][part]
        for names, values in _columns(gaussians, part):
            for name, column in zip(names, values.T, strict=True):
                rows[name] = column
        file.write(rows.tobytes())
    for table in extra.tables:
        file.write(table.rows)
    return list(extra.lost)


def _record(gaussians: Gaussians, extra: Extra) -> np.dtype[np.void]:
    """Return how a splat lies in the file; normals have their usual place, others come last."""
    k = gaussians.sh.shape[1]
    rest = sorted(rest_names(k), key=lambda name: int(name.rpartition("_")[2]))
    own = {name: extra.columns.dtype[name].str for name in extra.names}
    kinds = dict.fromkeys(NAMES["means"], "<f8" if gaussians.origin else "<f4")
    kinds |= {name: own.get(name, "<f4") for name in NORMALS}
    kinds |= dict.fromkeys([*NAMES["sh"], *rest, *NAMES["opacities"], *NAMES["scales"], *NAMES["quats"]], "<f4")
    return np.dtype([*kinds.items(), *((name, kind) for name, kind in own.items() if name not in kinds)])


def _columns(gaussians: Gaussians, part: slice) -> Iterator[tuple[list[str], npt.NDArray[np.floating]]]:
    """Yield names, and the values of some splats for them."""
    means, sh, scales = gaussians.means[part], gaussians.sh[part], gaussians.scales[part]
    yield [*NAMES["means"]], means.astype(np.float64) + gaussians.origin if gaussians.origin else means
    yield [*NAMES["sh"]], sh[:, 0]
    yield rest_names(sh.shape[1]), sh[:, 1:].reshape(len(sh), -1)
    opacities = np.clip(gaussians.opacities[part, None].astype(np.float64), OPACITY_EPS, 1.0 - OPACITY_EPS)
    yield [*NAMES["opacities"]], np.log(opacities / (1.0 - opacities))
    yield [*NAMES["scales"]], np.log(np.maximum(scales, np.finfo(np.float32).tiny))
    yield [*NAMES["quats"]], gaussians.quats[part]
