"""PLY as 3D Gaussian splatting writes it: logit opacities, log scales, channel-major colours.

Source: Kerbl et al. 2023, *3D Gaussian Splatting*, whose training code set the names of the columns.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from tsplat.errors import LoadError, LoadWarning
from tsplat.importance import most_important
from tsplat.io import compressed_ply
from tsplat.io.finish import finish, warn_dropped
from tsplat.io.options import LoadOptions
from tsplat.io.ply_columns import NAMES, find_columns, rest_names
from tsplat.io.ply_comments import comments_of, is_antialiased, said_up
from tsplat.io.ply_decode import Decoder, Piece
from tsplat.io.ply_header import MAGIC, read_header
from tsplat.io.ply_origin import origin_of_rows
from tsplat.io.ply_rows import find_rows, read_rows
from tsplat.scene import Gaussians

OPACITY_EPS = 1e-7
"""Opacities are kept this far from 0 and 1 in a file, where their logits would be infinite."""

WRITE_ROWS = 4096


def matches(head: bytes) -> bool:
    """Tell whether a file that begins with these bytes is a PLY."""
    return head.startswith(MAGIC)


def read(path: Path, options: LoadOptions, progress: Callable[[float], None]) -> Gaussians:
    """Read a splat PLY, ordinary or compressed; see `tsplat.io.load` for the parameters.

    Raises
    ------
    LoadError
        It is a PLY, but of a kind that holds no splats or is not read here.
    CorruptFileError
        Header and contents contradict each other, or the file ends early.
    """
    with path.open("rb") as file:
        header = read_header(file, path)
        about: dict[str, Any] = {"antialiased": is_antialiased(header.comments), "up": said_up(header.comments)}
        if compressed_ply.is_compressed(header):
            arrays, good = compressed_ply.read_arrays(file, path, header, progress)
            return finish(path, *arrays, good=good, max_splats=options.max_splats, **about)
        vertex = header.element("vertex")
        if vertex is None:
            raise LoadError(path, "holds no element 'vertex', so it is no splat scene; choose another file")
        columns = find_columns(path, vertex)
        start = find_rows(file, path, header, vertex)
        axes = [int(column) for column in columns["means"]]
        origin = origin_of_rows(file, header, vertex, start, axes)
        shifts = dict(zip(axes, origin, strict=True)) if origin else None

        def pieces(begin: float, end: float) -> Iterator[Piece]:
            done = 0
            for rows in read_rows(file, path, header, vertex, start, shifts):
                yield slice(done, done + len(rows)), rows
                done += len(rows)
                progress(begin + (end - begin) * done / vertex.count)

        decoder = Decoder(columns, options.raw_opacity)
        limit = options.max_splats
        if limit is None or limit >= vertex.count:
            arrays = decoder.gather(pieces(0.0, 1.0), vertex.count)
            clamped = sum(decoder.clamped)
        else:
            scores = decoder.score(pieces(0.0, 0.5), vertex.count)
            clamped = sum(decoder.clamped)
            warn_dropped(path, int(np.count_nonzero(scores < 0.0)), vertex.count, stacklevel=4)
            arrays = decoder.pick(pieces(0.5, 1.0), most_important(scores, limit))
    if clamped:
        problem = f"{clamped} of {vertex.count} opacities lay outside 0 to 1 and were clamped"
        warnings.warn(f"{path}: {problem}; logits should be read without raw_opacity", LoadWarning, stacklevel=3)
    return finish(path, *arrays, max_splats=None, origin=origin, **about)


def write(file: BinaryIO, gaussians: Gaussians) -> None:
    """Write a little-endian splat PLY, columns in the order of the original training code.

    Opacities of 0 and 1 and scales of 0 become the nearest that a file can hold.
    """
    k = gaussians.sh.shape[1]
    rest = sorted(rest_names(k), key=lambda name: int(name.rpartition("_")[2]))
    normals = ["nx", "ny", "nz"]
    names = [*NAMES["means"], *normals, *NAMES["sh"], *rest]
    names += [*NAMES["opacities"], *NAMES["scales"], *NAMES["quats"]]
    lines = ["ply", "format binary_little_endian 1.0", *comments_of(gaussians)]
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
