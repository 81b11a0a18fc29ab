"""Arrays to image files: the format by the suffix, the file whole or not there at all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from tsplat.errors import SaveError
from tsplat.files import replacing

F32 = npt.NDArray[np.float32]
U8 = npt.NDArray[np.uint8]

SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".npy")


def quantize(colors: F32) -> U8:
    """Return colours in [0, 1] as uint8 of the same shape, rounded to nearest; others are clamped."""
    return (np.clip(colors, 0.0, 1.0) * np.float32(255.0) + np.float32(0.5)).astype(np.uint8)


def check_suffix(path: str | Path) -> str:
    """Return the lower-case suffix of ``path``.

    Raises
    ------
    SaveError
        It names no format that `save` can write.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise SaveError(f"{path}: suffix '{suffix}' is not an image format; use one of {', '.join(SUFFIXES)}")
    return suffix


def save(path: str | Path, colors: F32, alphas: F32) -> Path:
    """Write an image; an existing file is replaced in one step.

    Parameters
    ----------
    path : str or Path
        ``.png``, ``.jpg``, ``.jpeg`` and ``.webp`` (lossless) hold 8-bit colours;
        ``.npy`` holds float32 [H, W, 4], colour and alpha, unquantised.
    colors : ndarray of float32, [H, W, 3]
        Colours, 0 to 1, background included.
    alphas : ndarray of float32, [H, W]
        Opacity, 0 to 1.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    SaveError
        The suffix is not known, or the folder cannot be written.
    """
    suffix, path = check_suffix(path), Path(path)
    with replacing(path) as file:
        if suffix == ".npy":
            np.save(file, np.concatenate([colors, alphas[..., None]], axis=2))
        else:
            _write_picture(file, suffix, quantize(colors))
    return path


def _write_picture(file: object, suffix: str, frame: U8) -> None:
    from PIL import Image  # 30 ms that only a saved picture has to pay

    options = {".webp": {"lossless": True}, ".png": {}}.get(suffix, {"quality": 95})
    kind = {".webp": "WEBP", ".png": "PNG"}.get(suffix, "JPEG")
    Image.fromarray(frame).save(file, kind, **options)  # type: ignore[arg-type]
