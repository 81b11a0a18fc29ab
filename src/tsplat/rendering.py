"""The contract every backend obeys: options in, a `Rendering` out, and the thresholds with their reasons.

Sources: Kerbl et al. 2023, *3D Gaussian Splatting*; gsplat 1.5, whose classic mode these numbers follow.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from tsplat import images
from tsplat.errors import OptionError, shown
from tsplat.given import real, triple, whole
from tsplat.processors import worker_count
from tsplat.train_views import TrainViews

F32 = npt.NDArray[np.float32]
U8 = npt.NDArray[np.uint8]
Antialias = Literal["classic", "mip", "relative"]
ANTIALIAS: tuple[Antialias, ...] = get_args(Antialias)

ALPHA_MIN = 1.0 / 255.0
"""Below this a splat cannot change an 8-bit pixel, so it is not drawn there."""

ALPHA_MAX = 0.999
"""Keeps some light for what is behind, so that transmittance never reaches zero."""

TRANSMITTANCE_MIN = 1e-4
"""A pixel is finished before the splat that would leave less light than this: nobody would see it."""

NEAR_PLANE = 0.01
"""World units in front of the eye where drawing starts; a projection closer than this explodes."""

FAR_PLANE = 1e10
"""World units where drawing ends: far enough for every scene, finite for every float32."""

EPS2D = 0.3
"""Pixels squared added to every 2D covariance, as in training: a splat never falls between pixels."""

BOX_VARIANCE = 1.0 / 12.0
"""Variance in pixels squared of the pixel's own box filter."""

SOFTENING = 0.1
"""Variance in pixels squared that ``relative`` blurs small images by: splats blended at the middle of a pixel
stand for all of it too hard, as opacities saturate. By photographs and by what shimmers: docs/quality.md."""

JACOBIAN_LIMIT = 1.3
"""The projection is linearised at most this many half fields of view off the axis: beyond, it explodes."""

SIGMA_EXTENT = math.sqrt(2.0 * math.log(255.0))
"""Standard deviations at which even an opaque splat falls below ALPHA_MIN: 3.33, so it cuts nothing more."""

TRAIN_FOCAL_GUESS = 1100.0
"""Focal length in pixels assumed for ``relative`` where no training camera is known: a phone's or
a DSLR's pictures downsampled to about 1.2 megapixels, as the common datasets are trained."""


@dataclass(frozen=True, slots=True)
class RenderOptions:
    """How to draw; every default agrees with gsplat's classic mode.

    Attributes
    ----------
    sh_degree : int
        Highest degree of spherical harmonics used, 0 to 4; a scene with fewer uses what it has.
    antialias : {"classic", "mip", "relative"}
        ``classic`` dilates by ``eps2d`` pixels squared. ``mip`` does the same and compensates the
        opacity. ``relative`` scales the dilation with the image against the training images, adds
        the pixel's box filter, and softens what it has blended, as far as the image is smaller.
    background : tuple of 3 floats
        Colour behind everything, usually 0 to 1.
    threads : int
        Worker threads; 0 means one per available processor.
    train_focal : float
        Focal length of the training images in pixels, for ``relative``.
    train_views : TrainViews, optional
        What the training cameras had in view, for ``relative``: where the eye comes nearer to a splat than any of
        them was, the dilation keeps its size in the world.
    memory : int
        Bytes that the work on a frame may take, beside the picture: above it, the picture is drawn in parts, to
        the same bits; 0 means half of what is free. Each tile's splats have to fit in any case.
    depths : bool
        Whether the expected depth is wanted; without it, drawing is a little faster.
    near_plane, far_plane : float
        Depth range drawn, in world units.
    eps2d : float
        Dilation in pixels squared.
    alpha_min : float
        A splat is not drawn where its alpha is below this; above 0, below 1.
    sigma_extent : float
        A splat is not drawn beyond this many standard deviations.

    Raises
    ------
    OptionError
        A value is out of its range.
    """

    sh_degree: int = 4
    antialias: Antialias = "classic"
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)
    threads: int = 0
    train_focal: float = TRAIN_FOCAL_GUESS
    train_views: TrainViews | None = None
    memory: int = 0
    depths: bool = True
    near_plane: float = NEAR_PLANE
    far_plane: float = FAR_PLANE
    eps2d: float = EPS2D
    alpha_min: float = ALPHA_MIN
    sigma_extent: float = SIGMA_EXTENT

    def __post_init__(self) -> None:
        for name, high in (("sh_degree", 4), ("threads", 1024), ("memory", None)):
            object.__setattr__(self, name, whole(name, getattr(self, name), 0, high))
        for name in ("train_focal", "near_plane", "far_plane", "eps2d", "alpha_min", "sigma_extent"):
            object.__setattr__(self, name, real(name, getattr(self, name)))
        known = isinstance(self.antialias, str) and self.antialias in ANTIALIAS
        _expect(known, "antialias", self.antialias, ", ".join(ANTIALIAS))
        object.__setattr__(self, "background", tuple(triple("background", self.background).tolist()))
        views = self.train_views is None or isinstance(self.train_views, TrainViews)
        _expect(views, "train_views", self.train_views, "a TrainViews or None")
        _expect(1e-3 <= self.train_focal <= 1e9, "train_focal", self.train_focal, "0.001 to 1e9 pixels")
        planes = 0.0 < self.near_plane < self.far_plane <= FAR_PLANE
        _expect(planes, "near_plane and far_plane", (self.near_plane, self.far_plane), "0 < near < far <= 1e10")
        _expect(0.0 <= self.eps2d < 100.0, "eps2d", self.eps2d, "0 to 100 pixels squared")
        _expect(1e-4 <= self.alpha_min < 1.0, "alpha_min", self.alpha_min, "0.0001 to 1")
        _expect(0.0 < self.sigma_extent <= 10.0, "sigma_extent", self.sigma_extent, "above 0, to 10")

    @property
    def worker_count(self) -> int:
        """Threads to use on this machine, at least 1."""
        return worker_count(self.threads)

    def filter2d(self, focal: float) -> tuple[float, float]:
        """Return how the 2D covariances are widened for an image of this focal length in pixels.

        Returns
        -------
        added : float
            Pixels squared added to both diagonal entries of every 2D covariance.
        reference : float
            The amount at which the stored opacity is right: opacities are multiplied by
            ``sqrt(det(S + reference I) / det(S + added I))``.

        Notes
        -----
        With ``q = (focal / train_focal)**2``, ``relative`` adds ``eps2d q`` (the dilation the optimiser
        saw, at this scale) and, as far as the pixel grew against the training pixel, its box filter.
        At q = 1 it is ``classic``. ``mip`` is Yu et al. 2024, *Mip-Splatting*, eq. 9, as gsplat has it.
        """
        if self.antialias == "classic":
            return self.eps2d, self.eps2d
        if self.antialias == "mip":
            return self.eps2d, 0.0
        dilation = self._train_dilation(focal)
        return dilation + self._smaller(focal) * BOX_VARIANCE, dilation

    def near_blur(self, focal: float) -> float:
        """Return by what the 2D covariance of a near splat is widened further, for an image of this focal length.

        Returns
        -------
        float
            Pixels squared, 0 where no training camera is known. A splat at depth z that no training camera saw
            from nearer than z_train gains ``(max(1, z_train / z)**2 - 1)`` times as much. It counts as its own
            size, not as what `filter2d` adds, so that its opacity stays as it is.
        """
        return self._train_dilation(focal) if self.train_views and self.antialias == "relative" else 0.0

    def _train_dilation(self, focal: float) -> float:
        """Return the dilation that the optimiser saw, in pixels squared of an image of this focal length."""
        return self.eps2d * (focal / self.train_focal) ** 2

    def softening(self, focal: float) -> float:
        """Return by which variance in pixels squared an image of this focal length is blurred once it is blended.

        Along columns, then rows, a pixel keeps ``1 - variance`` of itself and gets half of the rest from either
        neighbour.
        """
        # The root, as images just below the training size shimmer most.
        return SOFTENING * math.sqrt(self._smaller(focal)) if self.antialias == "relative" else 0.0

    def _smaller(self, focal: float) -> float:
        """Return how much of a pixel's area was not in a training pixel, 0 to 1."""
        return max(0.0, 1.0 - (focal / self.train_focal) ** 2)


@dataclass(frozen=True, eq=False, slots=True)
class Rendering:
    """What a camera saw.

    Attributes
    ----------
    colors : ndarray of float32, [H, W, 3]
        Colours with the background, usually 0 to 1, not clamped above.
    alphas : ndarray of float32, [H, W]
        Opacity, 0 to 1.
    depths : ndarray of float32, [H, W], or None
        Expected depth in world units along the view axis, 0 where nothing was drawn;
        None when `RenderOptions.depths` was off.
    visible : int
        Splats that touch the image; no more than so many where it was drawn in parts.
    pairs : int
        Pairs of a splat and a tile it may touch.
    blends : int
        Times a splat was blended into a cell of 4 by 4 pixels.
    stage_ms : dict of str to float
        Milliseconds by stage, in the order they ran.
    """

    colors: F32
    alphas: F32
    depths: F32 | None = None
    visible: int = 0
    pairs: int = 0
    blends: int = 0
    stage_ms: dict[str, float] = field(default_factory=dict)

    def frame(self) -> U8:
        """Return the colours as uint8 [H, W, 3], which is all an encoder needs."""
        return images.quantize(self.colors)

    def save(self, path: str | Path) -> Path:
        """Write the picture; see `tsplat.images.save` for the formats and errors."""
        return images.save(path, self.colors, self.alphas)


def own_antialias(antialiased: bool, otherwise: Antialias) -> Antialias:
    """Return how a scene is to be drawn where nobody said how: one trained with antialiasing needs ``mip``."""
    return "mip" if antialiased else otherwise


def _expect(valid: bool, name: str, value: object, expected: str) -> None:
    if not valid:
        raise OptionError(f"{name} must be {expected}, got {shown(value)}")
