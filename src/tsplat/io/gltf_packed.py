"""Splats of a glTF that are packed as SPZ in a buffer view.

Source: KHR_gaussian_splatting_compression_spz_2 of the KhronosGroup/glTF repository (pull request 2531) and its
older names. The draft would have SPZ turned by half a turn about y; writers and CesiumJS take its numbers as they
are for those of glTF, and so does this.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BytesIO

from tsplat.errors import LoadError
from tsplat.io import arrays as spz_arrays
from tsplat.io.arrays import Arrays
from tsplat.io.gltf_document import Document, Stretch
from tsplat.io.gltf_splats import Primitive
from tsplat.io.sog_json import Fields
from tsplat.io.spz import fill, open_streams
from tsplat.io.spz_header import ANTIALIASED, REST_COEFFICIENTS, Header, Streams

PACKED = "KHR_gaussian_splatting_compression_"
SPZ = (f"{PACKED}spz", f"{PACKED}spz_2")

SPZ_ALONE = "KHR_spz_gaussian_splats_compression"
"""The oldest draft, which stands without KHR_gaussian_splatting."""


def find_packed(document: Document, extensions: Fields, splatting: Fields | None) -> Primitive | None:
    """Return the splats of a primitive that are packed, or None.

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
        return _find_spz(document, extensions.inner(SPZ_ALONE))
    if splatting is None or not splatting.has("extensions"):
        return None
    inner = splatting.inner("extensions")
    for name in inner.values:
        if name in SPZ:
            return _find_spz(document, inner.inner(name))
        if name.startswith(PACKED):
            raise document.packed(name)
    return None


def _find_spz(document: Document, fields: Fields) -> Primitive:
    stretch = document.stretch(fields)
    with _told_of(document, fields, stretch):
        header, _ = _open(document, stretch)

    def fill_from_spz(out: Arrays, progress: Callable[[float], None]) -> None:
        with _told_of(document, fields, stretch):
            fill(spz_arrays.Arrays(*out), *_open(document, stretch), progress, turned=False)

    antialiased = bool(header.flags & ANTIALIASED)
    return Primitive(header.count, 1 + REST_COEFFICIENTS[header.sh_degree], fill_from_spz, antialiased)


def _open(document: Document, stretch: Stretch) -> tuple[Header, Streams]:
    content = stretch.read()
    return open_streams(document.path, BytesIO(content), len(content))


@contextmanager
def _told_of(document: Document, fields: Fields, stretch: Stretch) -> Iterator[None]:
    """Say of an error in an SPZ where in the glTF it lies."""
    try:
        yield
    except LoadError as error:
        offset = None if error.offset is None else stretch.start + error.offset
        problem = f"{fields.where}bufferView: its SPZ {error.problem}"
        raise type(error)(document.path, problem, offset) from error
