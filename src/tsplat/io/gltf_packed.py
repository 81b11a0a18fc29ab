"""Splats of a glTF that are packed as SPZ in a buffer view.

Source: KHR_gaussian_splatting_compression_spz_2 of the KhronosGroup/glTF repository (pull request 2531) and its
older names. The draft would have SPZ turned by half a turn about y; writers and CesiumJS take its numbers as they
are for those of glTF, and so does this.
"""

from __future__ import annotations

from tsplat.errors import LoadError
from tsplat.io.gltf_document import Document
from tsplat.io.gltf_transform import Arrays
from tsplat.io.sog_json import Fields
from tsplat.io.spz import unpack
from tsplat.io.spz_header import ANTIALIASED

SPZ = "KHR_gaussian_splatting_compression_spz"
"""Followed by ``_2`` in some drafts."""

SPZ_ALONE = "KHR_spz_gaussian_splats_compression"
"""The oldest draft, which stands without KHR_gaussian_splatting."""

PACKED = "KHR_gaussian_splatting_compression_"


def find_packed(document: Document, extensions: Fields, splatting: Fields | None) -> tuple[Arrays, bool] | None:
    """Return the splats of a primitive that are packed, and whether they are antialiased, or None.

    Parameters
    ----------
    document : Document
        The file.
    extensions : Fields
        Those of the primitive.
    splatting : Fields, optional
        KHR_gaussian_splatting, where it is among them.

    Raises
    ------
    CorruptFileError
        They cannot be unpacked.
    LoadError
        They are packed in a way that is not known.
    """
    if extensions.has(SPZ_ALONE):
        return _read_spz(document, extensions.inner(SPZ_ALONE))
    if splatting is None or not splatting.has("extensions"):
        return None
    inner = splatting.inner("extensions")
    for name in inner.values:
        if name.startswith(SPZ):
            return _read_spz(document, inner.inner(name))
        if name.startswith(PACKED):
            raise document.packed(name)
    return None


def _read_spz(document: Document, fields: Fields) -> tuple[Arrays, bool]:
    stretch = document.stretch(fields)
    try:
        header, arrays = unpack(document.path, stretch.read(), lambda _: None)
    except LoadError as error:
        offset = None if error.offset is None else stretch.start + error.offset
        raise type(error)(document.path, f"{fields.where}bufferView: its SPZ {error.problem}", offset) from error
    return Arrays(*arrays), bool(header.flags & ANTIALIASED)
