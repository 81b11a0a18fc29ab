"""Splats of one primitive of a glTF mesh: which attributes they have, and the arrays they fill.

Source: KHR_gaussian_splatting of the KhronosGroup/glTF repository, and its drafts of 2024 and 2025, whose names
began with an underscore and whose opacities and base colours were those of COLOR_0.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from tsplat.errors import shown
from tsplat.io.arrays import Arrays
from tsplat.io.gltf_accessors import Accessor, find_accessor
from tsplat.io.gltf_colors import show_linear
from tsplat.io.gltf_document import Document, items
from tsplat.io.gltf_packed import find_packed
from tsplat.io.gltf_splats import Fill, Primitive
from tsplat.io.sog_json import Fields
from tsplat.scene import SH_C0, SH_COEFFICIENTS

F32 = npt.NDArray[np.float32]

EXTENSION = "KHR_gaussian_splatting"
PREFIXES = (f"{EXTENSION}:", "_", "")

COLOR_SPACES = (
    *("srgb_rec709_display", "lin_rec709_display"),
    *("lin_rec709_scene", "BT.709-sRGB", "BT.709-srgb", "BT.709-linear", "BT.709", "sRGB", "linear"),  # in drafts
)

_SH_NAME = re.compile(rf"(?:{EXTENSION}:|_)?SH_DEGREE_(\d)_COEF_\d")


@dataclass(frozen=True, slots=True)
class Attributes:
    """Accessors of all attributes; ``colors`` has the opacities and the first coefficients that are missing."""

    means: Accessor
    quats: Accessor
    scales: Accessor
    opacities: Accessor | None
    base: Accessor | None
    rest: tuple[Accessor, ...]
    colors: Accessor | None


def find_primitives(document: Document, mesh: Fields) -> tuple[list[Primitive], set[str]]:
    """Return the splats of a mesh, and what is unusual about them; triangles and points are passed over.

    Raises
    ------
    CorruptFileError
        An attribute is missing or not what it should be.
    LoadError
        It is packed in a way that is not known.
    """
    found, problems = [], set[str]()
    for primitive in items(mesh, "primitives"):
        if not primitive.has("extensions"):
            continue
        extensions = primitive.inner("extensions")
        splatting = extensions.inner(EXTENSION) if extensions.has(EXTENSION) else None
        packed = find_packed(document, extensions, splatting)
        if packed is not None:
            found.append(packed)
        elif splatting is not None:
            attributes = _attributes(document, primitive.inner("attributes"))
            count, k = attributes.means.count, 1 + len(attributes.rest)
            found.append(Primitive(count, k, _reader(attributes, _is_linear(splatting))))
            problems |= _problems(splatting)
    return found, problems


def _reader(attributes: Attributes, linear: bool) -> Fill:
    def fill(out: Arrays, progress: Callable[[float], None]) -> None:
        attributes.means.read(out.means)
        attributes.quats.read(out.quats)
        out.quats[:] = np.roll(out.quats, 1, axis=1)  # xyzw in the file
        attributes.scales.read(out.scales)
        _refuse_negative(attributes.scales, out.scales)
        for index, accessor in enumerate(attributes.rest, 1):
            accessor.read(out.sh[:, index])
            progress(index / len(attributes.rest))
        if attributes.colors is not None:
            colors = np.empty((attributes.colors.count, attributes.colors.width), np.float32)
            attributes.colors.read(colors)
            out.opacities[:], out.sh[:, 0] = colors[:, -1], (colors[:, :3] - 0.5) / SH_C0
        if attributes.opacities is not None:
            attributes.opacities.read(out.opacities[:, None])
        if attributes.base is not None:
            attributes.base.read(out.sh[:, 0])
        if linear:
            show_linear(out.sh)

    return fill


def _refuse_negative(accessor: Accessor, scales: F32) -> None:
    negative = (scales < 0.0).any(axis=1)
    if negative.any():
        row = int(negative.argmax())
        problem = f"row {row} of {accessor.fields.where[:-1]} has a scale of {scales[row].min():.6g}"
        raise accessor.fields.corrupt(f"{problem}, expected 0 or more")


def _attributes(document: Document, fields: Fields) -> Attributes:
    def find(name: str, *kinds: str) -> Accessor | None:
        known = next((prefix + name for prefix in PREFIXES if fields.has(prefix + name)), None)
        return None if known is None else find_accessor(document, fields, known, kinds)

    def need(name: str, *kinds: str) -> Accessor:
        if (accessor := find(name, *kinds)) is None:
            raise fields.wrong(name if name == "POSITION" else PREFIXES[0] + name, "the index of an accessor")
        return accessor

    opacities, base = find("OPACITY", "SCALAR"), find("SH_DEGREE_0_COEF_0", "VEC3")
    colors = None if opacities and base else find("COLOR_0", *(("VEC3", "VEC4") if opacities else ("VEC4",)))
    if colors is None:
        opacities, base = need("OPACITY", "SCALAR"), need("SH_DEGREE_0_COEF_0", "VEC3")
    degrees = [int(name[1]) for name in map(_SH_NAME.fullmatch, fields.values) if name]
    degree = min(max(degrees, default=0), len(SH_COEFFICIENTS) - 1)
    rest = [f"SH_DEGREE_{n}_COEF_{m}" for n in range(1, degree + 1) for m in range(2 * n + 1)]
    found = Attributes(
        means=need("POSITION", "VEC3"),
        quats=_normalized(need("ROTATION", "VEC4")),
        scales=need("SCALE", "VEC3"),
        opacities=opacities and _normalized(opacities),
        base=base,
        rest=tuple(need(name, "VEC3") for name in rest),
        colors=colors and _normalized(colors),
    )
    for each in (found.quats, found.scales, opacities, base, *found.rest, colors):
        if each is not None and each.count != found.means.count:
            raise each.fields.wrong("count", f"{found.means.count} as in POSITION")
    return found


def _normalized(accessor: Accessor) -> Accessor:
    # Integers can mean nothing else here, and some writers forget to say so.
    return replace(accessor, normalized=True)


def _is_linear(splatting: Fields) -> bool:
    space = splatting.values.get("colorSpace")
    return isinstance(space, str) and "lin" in space.lower()


def _problems(splatting: Fields) -> set[str]:
    expected = {"kernel": ("ellipse",), "projection": ("perspective",), "colorSpace": COLOR_SPACES}
    return {
        f"{name} {shown(splatting.values[name])} is drawn as {' or '.join(known[:2])}"
        for name, known in expected.items()
        if splatting.has(name) and splatting.values[name] not in known
    }
