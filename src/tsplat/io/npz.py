"""``.npz``: what a trainer kept, exported by ``numpy.savez``: log scales, logit opacities, ``wxyz`` of any length.

Source: the names of gsplat's ``simple_trainer.py`` and of nerfstudio's ``splatfacto.py``. They may stand behind
what led to them in the checkpoint, such as ``splats.`` or ``pipeline/_model.gauss_params.``.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tsplat.errors import LoadError
from tsplat.io.activation import Activation
from tsplat.io.finish import finish
from tsplat.io.npz_arrays import Header, read_array, read_header
from tsplat.io.options import LoadOptions
from tsplat.io.sog_files import Archive
from tsplat.origin import find_origin
from tsplat.scene import SH_C0, SH_COEFFICIENTS, Gaussians

F32 = npt.NDArray[np.float32]
Members = dict[str, str]

ZIP_MAGIC = b"PK\x03\x04"
NAME_START = 30
SUFFIX = ".npy"

SHAPES: dict[str, tuple[tuple[int, ...], ...]] = {
    "means": ((3,),),
    "quats": ((4,),),
    "scales": ((3,),),
    "opacities": ((), (1,)),
    "sh0": ((1, 3), (3,)),
    "shN": tuple((k - 1, 3) for k in SH_COEFFICIENTS),
}
"""What one splat has of each."""

NERFSTUDIO = {"sh0": "features_dc", "shN": "features_rest"}
"""What goes by another name there."""


SPARE_SPLATS = 1 << 16
"""Means of more splats than this, and than they have bytes, are a trap: even halves in order take three each."""


def matches(head: bytes) -> bool:
    """Tell whether a file that begins with these bytes is a zip whose first file is, or may be, an array."""
    end = NAME_START + int.from_bytes(head[26:28], "little")
    seen = head[NAME_START:end].endswith(SUFFIX.encode()) or end > len(head)
    return head.startswith(ZIP_MAGIC) and seen


def read(path: Path, options: LoadOptions, progress: Callable[[float], None]) -> Gaussians:
    """Read an exported checkpoint; see `tsplat.io.load` for the parameters.

    Raises
    ------
    LoadError
        It holds no scene, or more than one.
    CorruptFileError
        It is no whole zip, or an array is not what its header or the others say.
    """
    # What is too large for float32 becomes inf; finish counts and drops it.
    with Archive(path) as archive, np.errstate(over="ignore", invalid="ignore"):
        members = _members(path, archive)
        headers = _headers(archive, members)
        arrays = {}
        for done, (name, member) in enumerate(members.items(), 1):
            arrays[name] = read_array(archive, member, headers[name], wide=name == "means")
            progress(done / len(members))
        origin = find_origin(arrays["means"])
        means = (arrays["means"] - origin if origin else arrays["means"]).astype(np.float32, copy=False)
        quats, scales = arrays["quats"], arrays["scales"].astype(np.float32)
        opacities, sh = arrays["opacities"].reshape(-1).astype(np.float32), arrays["sh0"].reshape(-1, 1, 3)
        activation = Activation(options)
        activation.scales(scales)
        activation.opacities(opacities)
        if "shN" in arrays and arrays["shN"].shape[1]:
            sh = np.concatenate([sh, arrays["shN"]], axis=1)
        elif members["sh0"].endswith(f"{NERFSTUDIO['sh0']}{SUFFIX}"):
            # Without harmonics, nerfstudio trains colours from 0 to 1 by their logits.
            sh = (_sigmoid(sh) - np.float32(0.5)) / np.float32(SH_C0)
        activation.warn(path, len(means), stacklevel=4)
        return finish(path, means, quats, scales, opacities, sh, max_splats=options.max_splats, origin=origin)


def _members(path: Path, archive: Archive) -> Members:
    # The file of each array. Those of a scene have the same way to them; what else is in the zip does not matter.
    keys_by_way: dict[str, set[str]] = {}
    for name in archive.names():
        stem = name.removesuffix(SUFFIX)
        start = max(stem.rfind("."), stem.rfind("/")) + 1
        keys_by_way.setdefault(stem[:start], set()).add(stem[start:])
    scenes = [way for way, keys in keys_by_way.items() if "means" in keys and keys & {"sh0", NERFSTUDIO["sh0"]}]
    if len(scenes) != 1:
        expected = "expected one: means, quats, scales, opacities and sh0 or features_dc"
        raise LoadError(path, f"holds {len(scenes) or 'no'} scenes, {expected}; export the splats of a checkpoint")
    keys = keys_by_way[scenes[0]]
    names = {name: name for name in SHAPES}
    if "sh0" not in keys:
        names |= NERFSTUDIO
    elif "shN" not in keys:
        del names["shN"]
    return {name: f"{scenes[0]}{key}{SUFFIX}" for name, key in names.items()}


def _headers(archive: Archive, members: Members) -> dict[str, Header]:
    headers = {name: read_header(archive, member) for name, member in members.items()}
    count = headers["means"].shape[0] if headers["means"].shape else 0
    for name, header in headers.items():
        expected = [[count, *shape] for shape in SHAPES[name]]
        if list(header.shape) not in expected:
            problem = f"has shape {str(list(header.shape))[:60]}, expected {' or '.join(map(str, expected))}"
            raise archive.corrupt(members[name], problem)
    size = archive.size(members["means"])
    if count > SPARE_SPLATS + size:
        raise archive.corrupt(
            members["means"], f"holds {size} bytes, expected at least {count} for {count} splats"
        )
    return headers


def _sigmoid(values: F32) -> F32:
    sigmoids: F32 = np.reciprocal(1 + np.exp(-values))
    return sigmoids
