"""The scene: frozen parallel arrays, checked once, ready to draw.

Loaders undo every file's encoding (log scales, logit opacities, quantised colours); nothing after
this module asks where a scene came from.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from tsplat.errors import SceneError, shown
from tsplat.extra import Extra

F32 = npt.NDArray[np.float32]
Vector = tuple[float, float, float]

SH_COEFFICIENTS = (1, 4, 9, 16, 25)
"""How many spherical-harmonics coefficients a colour has at degree 0, 1, 2, 3 and 4."""

SH_C0 = 0.28209479177387814
"""The constant basis of the spherical harmonics, 1 / (2 sqrt(pi))."""

ARRAYS = ("means", "quats", "scales", "opacities", "sh")


@dataclass(frozen=True, eq=False, slots=True, weakref_slot=True)
class Gaussians:
    """N anisotropic 3D Gaussians, activated and ready to draw.

    Arrays are copied only when they are not already float32, C-ordered and read-only.

    Attributes
    ----------
    means : ndarray of float32, [N, 3]
        Centres in world units, in the axes of the file.
    quats : ndarray of float32, [N, 4]
        Unit rotations, ``wxyz``.
    scales : ndarray of float32, [N, 3]
        Standard deviations along the rotated axes in world units, linear, not negative.
    opacities : ndarray of float32, [N]
        Peak opacity, in [0, 1].
    sh : ndarray of float32, [N, K, 3]
        Spherical-harmonics coefficients of the colour, K in 1, 4, 9, 16, 25; a colour is
        ``max(0, 0.5 + sum(basis_k(direction) * sh[:, k]))``.
    antialiased : bool
        Trained with opacities compensated for the dilation, so to be drawn with ``mip`` (Yu et al. 2024).
    up : tuple of 3 floats, optional
        Unit vector: what is up, where the file said so.
    origin : tuple of 3 floats, optional
        Where (0, 0, 0) of ``means`` is in the world, in float64: scenes far from the world's origin for their size
        would lose detail in float32. None is the world's own.
    extra : Extra, optional
        What else a PLY holds, where it was asked for, see `tsplat.io.load`.

    Raises
    ------
    SceneError
        A shape disagrees with the others, or a value is not finite or out of its range.
    """

    means: F32
    quats: F32
    scales: F32
    opacities: F32
    sh: F32
    antialiased: bool = False
    up: Vector | None = None
    origin: Vector | None = None
    extra: Extra | None = None

    def __post_init__(self) -> None:
        self._own_shaped()
        for name in ARRAYS:
            _check_finite(name, getattr(self, name))
        self._check_ranges()

    @classmethod
    def of_finite(cls, means: F32, quats: F32, scales: F32, opacities: F32, sh: F32, **about: Any) -> Self:
        """Return a scene of arrays in which nan and inf were looked for already; the rest is checked."""
        scene = object.__new__(cls)
        values = {each.name: each.default for each in fields(cls)}
        values |= {"means": means, "quats": quats, "scales": scales, "opacities": opacities, "sh": sh} | about
        for name, value in values.items():
            object.__setattr__(scene, name, value)
        scene._own_shaped()
        scene._check_ranges()
        return scene

    def _own_shaped(self) -> None:
        for name in ("up", "origin"):
            _check_vector(name, getattr(self, name))
        if self.up is not None and not any(self.up):
            raise SceneError("up must be a direction, got three zeros")
        for name in ARRAYS:
            object.__setattr__(self, name, _own(name, getattr(self, name)))
        if not isinstance(self.antialiased, (bool, np.bool_)):
            raise SceneError(f"antialiased must be True or False, got {shown(self.antialiased)}")
        object.__setattr__(self, "antialiased", bool(self.antialiased))
        n = len(self.means) if self.means.ndim else 0
        _check_shape("means", self.means, (n, 3))
        _check_shape("quats", self.quats, (n, 4))
        _check_shape("scales", self.scales, (n, 3))
        _check_shape("opacities", self.opacities, (n,))
        if self.sh.ndim != 3 or self.sh.shape[1] not in SH_COEFFICIENTS:
            raise SceneError(f"sh must have shape [{n}, K, 3], K in {SH_COEFFICIENTS}, got {list(self.sh.shape)}")
        _check_shape("sh", self.sh, (n, self.sh.shape[1], 3))

        if self.extra is not None:
            _check_shape("extra.columns", self.extra.columns, (n,))

    def _check_ranges(self) -> None:
        _check_range("scales", self.scales, 0.0, math.inf)
        _check_range("opacities", self.opacities, 0.0, 1.0)

    def __reduce__(self) -> tuple[type[Gaussians], tuple[Any, ...]]:
        # NumPy unpickles read-only arrays as writable; the constructor freezes them again.
        return Gaussians, tuple(getattr(self, each.name) for each in fields(self))

    def __len__(self) -> int:
        return len(self.means)

    @property
    def arrays(self) -> tuple[F32, F32, F32, F32, F32]:
        """Means, quats, scales, opacities and sh."""
        return self.means, self.quats, self.scales, self.opacities, self.sh

    @property
    def sh_degree(self) -> int:
        """Degree of the spherical harmonics that are stored, 0 to 4."""
        return SH_COEFFICIENTS.index(self.sh.shape[1])

    @property
    def nbytes(self) -> int:
        """Memory of all arrays, in bytes."""
        return sum(array.nbytes for array in self.arrays)

    def take(self, source_from_kept: npt.NDArray[np.integer] | Sequence[int]) -> Gaussians:
        """Return the chosen Gaussians, in the order of the indices."""
        chosen = _indices(source_from_kept, len(self))
        means, quats, scales, opacities, sh = (array[chosen] for array in self.arrays)
        extra = self.extra and self.extra.take(chosen)
        return replace(self, means=means, quats=quats, scales=scales, opacities=opacities, sh=sh, extra=extra)


def a_scene(value: object) -> Gaussians:
    """Return a scene that a caller handed over, or raise a `SceneError` that says what it is instead."""
    if not isinstance(value, Gaussians):
        raise SceneError(f"a scene must be Gaussians, as tsplat.load returns them, got {shown(value)}")
    return value


def _indices(values: npt.NDArray[np.integer] | Sequence[int], count: int) -> npt.NDArray[np.intp]:
    try:
        indices = np.asarray(values)
    except (ValueError, TypeError):
        indices = np.empty((0, 0))
    if indices.ndim != 1 or (indices.size and indices.dtype.kind not in "iu"):
        raise SceneError(
            f"indices must be a list of whole numbers; numpy.flatnonzero makes them of a mask; got {shown(values)}"
        )
    if indices.size and not (indices.min() >= -count and indices.max() < count):
        raise SceneError(f"indices must be less than {count}, got {indices.min()} to {indices.max()}")
    return indices.astype(np.intp)


def _own(name: str, array: npt.ArrayLike) -> F32:
    try:
        given = np.asarray(array)
    except (ValueError, TypeError):
        given = np.empty(0, np.object_)
    if given.dtype.kind not in "iufb":
        raise SceneError(f"{name} must be an array of numbers, got {shown(array)}")
    # Kernels are compiled for each new dtype and layout; here they become one.
    with np.errstate(over="ignore"):  # what is beyond float32 is infinite, and refused
        owned = np.ascontiguousarray(given, np.float32)
    if owned.flags.writeable:
        owned = owned.view()
        owned.flags.writeable = False
    return owned


def _check_shape(name: str, array: npt.NDArray[Any], shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise SceneError(f"{name} must have shape {list(shape)}, got {list(array.shape)}")


def _check_vector(name: str, vector: Vector | None) -> None:
    if vector is not None and not (len(vector) == 3 and all(map(math.isfinite, vector))):
        raise SceneError(f"{name} must be three finite numbers or None, got {vector!r}")


def _check_finite(name: str, array: F32) -> None:
    # A nan or inf anywhere shows in the sum: one pass, no temporary mask. In float32 it is quicker, but may
    # overflow; the sum of finite float32 values, taken in float64, is finite.
    with np.errstate(over="ignore", invalid="ignore"):
        finite = math.isfinite(array.sum()) or math.isfinite(np.sum(array, dtype=np.float64))
    if not finite:
        raise SceneError(f"{name} must be finite, but holds nan or inf; drop those Gaussians first")


def _check_range(name: str, array: F32, low: float, high: float) -> None:
    if array.size and (array.min() < low or array.max() > high):
        raise SceneError(f"{name} must lie in [{low}, {high}], got [{array.min()}, {array.max()}]")
