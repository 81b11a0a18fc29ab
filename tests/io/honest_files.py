"""A small honest file of each kind that is read, to be damaged: one line each, and a new format adds its own."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.io import sogs
from tests.io.colmaps import colmap_binary, colmap_text
from tests.io.compressed_plys import small_tables
from tests.io.gltfs import EXTENSION, SPLATTING, Made, scene_of
from tests.io.gsplat_pngs import compressed
from tests.io.ksplats import Part, gaussforge, ksplat
from tests.io.plys import Table, in_halves, ply_bytes, splat_names, splats
from tests.io.splats import record
from tests.io.spzs import SH_VALUES, Splat, bare, framed, zipped
from tests.io.test_npz import named, trained
from tests.io.tsplats import small
from tests.scenes import random_gaussians
from tsplat.io.gltf_packed import SPZ

Files = dict[str, bytes]
"""Contents by name; the first one is opened."""

RNG = np.random.default_rng(5)
SCENE = random_gaussians(RNG, 7, 1)
PART = Part(SCENE, 4, (2, 1))
POINTS = [(0.5 * i, -i, i * i, 40 * i, 255 - i, 7) for i in range(6)]
FACES = Table("face", [("list uchar int", "vertex_indices"), ("uchar", "flag")], [[[0, 1, 2], 7], [[], 8]])


def _vertices(sh_degree: int, scalar: str = "float") -> Table:
    rows = RNG.normal(0, 1, (5, len(splat_names(sh_degree)))).astype(np.float32)
    return splats(rows.tolist(), sh_degree, scalar)


def _points() -> Table:
    rows = [[*point[:3], *point[3:]] for point in POINTS]
    names = [
        ("double", "x"),
        ("float", "y"),
        ("float", "z"),
        ("uchar", "red"),
        ("uchar", "green"),
        ("uchar", "blue"),
    ]
    return Table("vertex", names, rows)


def _filtered() -> Table:
    table = _vertices(0)
    names = [("float", f"scalar_{name}" if name not in "xyz" else name) for _, name in table.columns]
    return Table("vertex", [*names, ("float", "filter_3D")], [[*row, 0.1] for row in table.rows])


def _spz_splats(version: int, degree: int = 1) -> list[Splat]:
    rest = RNG.integers(0, 256, (5, SH_VALUES[degree])).tolist()
    quat = (1, 200, -100, 50) if version > 2 else (100, 150, 130)
    return [Splat((index, -index, 3), quat=quat, sh=values) for index, values in enumerate(rest)]


def _framed_spz(degree: int = 1) -> bytes:
    return framed(_spz_splats(4, degree), 4, degree)


def _gzipped_spz(version: int) -> bytes:
    return zipped(bare(_spz_splats(version), version, 1))


def _turned_gltf() -> Made:
    """Return a glTF of the same splats in two places, one of them turned, stretched and mirrored."""
    made = scene_of(SCENE)
    made.root["nodes"] = [
        {"children": [1, 2]},
        {"mesh": 0},
        {"mesh": 0, "scale": [1, -2, 3], "rotation": [0, 1, 0, 1]},
    ]
    made.root["accessors"][0]["sparse"] = {
        "count": 2,
        "indices": {"bufferView": made.view(bytes([1, 5])), "componentType": 5121},
        "values": {"bufferView": made.view(bytes(24))},
    }
    return made


def _packed_glb() -> bytes:
    made = Made()
    packed = {"extensions": {SPZ[0]: {"bufferView": made.view(_gzipped_spz(3))}}}
    made.primitive({}, extensions={EXTENSION: {**SPLATTING, **packed}})
    return made.glb()


def _checkpoint(save: Callable[..., None]) -> bytes:
    stream = io.BytesIO()
    save(stream, **named(trained(SCENE), "splats.", False))
    return stream.getvalue()


def _folder(scene: sogs.Scene) -> Files:
    return scene.files()


def _streamed() -> Files:
    def leaf(file: int, offset: int, count: int) -> dict[str, object]:
        return {"bound": {}, "lods": {"0": {"file": file, "offset": offset, "count": count}}}

    leaves = [leaf(0, 0, 3), {"children": [leaf(1, 1, 4), leaf(0, 5, 2)]}]
    names = ["a/meta.json", "b.sog"]
    tree = {"lodLevels": 1, "environment": "b.sog", "filenames": names, "tree": {"children": leaves}}
    inner = {f"a/{name}": content for name, content in sogs.made_up(RNG, bands=0).files().items()}
    return {"lod-meta.json": json.dumps(tree).encode(), "b.sog": sogs.made_up(RNG).zipped(), **inner}


def _gsplat_png() -> Files:
    splats = trained(random_gaussians(RNG, 9, 1))
    return compressed(splats | {"shN": splats["shN"][:4]}, RNG.integers(0, 4, 9))


MADE_UP = sogs.made_up(RNG)
HONEST: dict[str, Files] = {
    "PLY": {"scene.ply": ply_bytes([_vertices(0)])},
    "PLY behind faces": {"scene.ply": ply_bytes([FACES, _vertices(1), replace(FACES, name="edge")])},
    "PLY, big-endian": {"scene.ply": ply_bytes([FACES, _vertices(0, "double")], "binary_big_endian")},
    "PLY, ASCII": {"scene.ply": ply_bytes([FACES, _vertices(0)], "ascii")},
    "PLY in gzip": {"scene.ply.gz": zipped(ply_bytes([_vertices(0)]))},
    "PLY of points": {"scene.ply": ply_bytes([_points(), FACES])},
    "PLY of points, ASCII": {"scene.ply": ply_bytes([_points()], "ascii")},
    "PLY of halves": {"scene.ply": in_halves(_vertices(0))},
    "PLY, renamed and filtered": {"scene.ply": ply_bytes([_filtered()])},
    "COLMAP's points": {"points3D.bin": colmap_binary(POINTS)},
    "COLMAP's points as text": {"points3D.txt": colmap_text(POINTS)},
    "compressed PLY": {"scene.compressed.ply": ply_bytes(small_tables(1, 5))},
    "compressed PLY, old": {"scene.compressed.ply": ply_bytes(small_tables(0, 300, colors=False))},
    "splat": {"scene.splat": b"".join(record(means=(i, 0, -i), scales=(0.1, 1, i)) for i in range(6))},
    "ksplat 0": {"scene.ksplat": ksplat(0, [PART])},
    "ksplat 1": {"scene.ksplat": ksplat(1, [PART, Part(SCENE, 3, (1,))], room=2)},
    "ksplat 2": {"scene.ksplat": ksplat(2, [PART])},
    "ksplat of GaussForge": {"scene.ksplat": gaussforge(SCENE)},
    **{f"SPZ {version}": {"scene.spz": _gzipped_spz(version)} for version in (1, 2, 3)},
    "SPZ without gzip": {"scene.spz": bare(_spz_splats(2), 2, 1)},
    "SPZ 4": {"scene.spz": _framed_spz()},
    "SPZ 4 of degree 0": {"scene.spz": _framed_spz(0)},
    "GLB": {"scene.glb": _turned_gltf().glb()},
    "glTF": {"scene.gltf": _turned_gltf().gltf()},
    "glTF in a folder": {
        "scene.gltf": scene_of(SCENE).gltf("scene.bin"),
        "scene.bin": bytes(scene_of(SCENE).content),
    },
    "GLB of SPZ": {"scene.glb": _packed_glb()},
    "NumPy": {"scene.npz": _checkpoint(np.savez)},
    "NumPy, deflated": {"scene.npz": _checkpoint(np.savez_compressed)},
    "SOG": {"scene.sog": sogs.made_up(RNG).zipped()},
    "SOG, deflated": {"scene.sog": sogs.made_up(RNG, bands=0).zipped(zipfile.ZIP_DEFLATED)},
    "SOG 1": {"scene.sog": sogs.made_up_old(RNG).zipped()},
    "SOG in a folder": _folder(sogs.made_up(RNG)),
    "SOG 1 in a folder": _folder(sogs.made_up_old(RNG, 0)),
    "SOG, streamed": _streamed(),
    "tsplat": {"scene.tsplat": small()},
    "gsplat PNG": _gsplat_png(),
    "PLY in a zip": {"scene.zip": sogs.zipped({"a/scene.ply": ply_bytes([_vertices(0)]), "a/b.txt": b"words"})},
    "SOG in a zip": {"scene.zip": sogs.zipped({f"a/{name}": raw for name, raw in _folder(MADE_UP).items()})},
}


def written(folder: Path, files: Files) -> Path:
    """Write files, those that are there already anew, and return the path of the first."""
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)
    return folder / next(iter(files))
