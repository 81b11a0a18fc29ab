"""The planes of a SOG scene: WebP images of which each pixel is four bytes of one splat.

Source: the WebP container specification (RIFF) for the sizes; the pixels are decoded by Pillow.
"""

from __future__ import annotations

import io
import struct

import numpy as np
import numpy.typing as npt

from tsplat.io.sog_files import Files

U8 = npt.NDArray[np.uint8]

PIXELS_MAX = 1 << 26
"""No larger plane is decoded: 67 million splats, and below where Pillow warns of a bomb."""

SPARE_PIXELS = 1 << 16
"""What a plane may have beyond the pixels it needs; writers round its sides up."""

HEADER_BYTES = 30


def plane_size(files: Files, name: str, pixels: int, most: int | None = None) -> tuple[int, int]:
    """Return width and height by the header of an image; see `read_plane` for the parameters.

    Raises
    ------
    CorruptFileError
        It is no WebP image, or of another size.
    """
    width, height = _size(files, name)
    allowed = min((2 * pixels if most is None else most) + SPARE_PIXELS, PIXELS_MAX)
    if not pixels <= width * height <= allowed:
        raise files.corrupt(name, f"is {width}x{height} pixels, expected {pixels} to {allowed} in all")
    return width, height


def read_plane(files: Files, name: str, pixels: int, most: int | None = None) -> U8:
    """Return the pixels of an image.

    Parameters
    ----------
    files : Files
        Where it is.
    name : str
        Its name there.
    pixels : int
        How many are needed.
    most : int, optional
        How many there may be, before some are spared for rounding; by default twice as many.

    Returns
    -------
    ndarray of uint8, [height, width, 4]
        RGBA, as many as asked for.

    Raises
    ------
    CorruptFileError
        It is no WebP image, broken, or of another size; nothing was decoded where the header says so.
    """
    width, height = plane_size(files, name, pixels, most)
    # Even noise takes four bytes a pixel, and a few for its tables.
    limit = 5 * width * height + SPARE_PIXELS
    encoded = files.read(name, limit + 1)
    riff_bytes = 8 + int.from_bytes(encoded[4:8], "little")
    if len(encoded) > limit or riff_bytes > len(encoded):
        problem = f"holds {len(encoded)} bytes, its header says {riff_bytes}, expected at most {limit}"
        raise files.corrupt(name, problem)
    return _decode(files, name, encoded, (width, height))


def _decode(files: Files, name: str, encoded: bytes, size: tuple[int, int]) -> U8:
    from PIL import Image

    try:
        with Image.open(io.BytesIO(encoded), formats=("WEBP",)) as image:
            if image.size != size:
                raise files.corrupt(name, f"is {image.size} pixels inside, expected {size} as its header says")
            return np.asarray(image if image.mode == "RGBA" else image.convert("RGBA"))
    except (OSError, SyntaxError, RuntimeError, EOFError, Image.DecompressionBombError) as error:
        raise files.corrupt(name, "cannot be decoded, expected a whole WebP image") from error


def _size(files: Files, name: str) -> tuple[int, int]:
    head = files.read(name, HEADER_BYTES)
    if len(head) < HEADER_BYTES or head[:4] != b"RIFF" or head[8:12] != b"WEBP":
        raise files.corrupt(name, f"begins with {head[:12]!r}, expected a WebP image")
    match head[12:16]:
        case b"VP8L":
            (bits,) = struct.unpack_from("<I", head, 21)
            return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
        case b"VP8X":
            width, height = head[24:27], head[27:30]
            return int.from_bytes(width, "little") + 1, int.from_bytes(height, "little") + 1
    raise files.corrupt(name, f"is a WebP of kind {head[12:16]!r}, expected a lossless one (VP8L)")
