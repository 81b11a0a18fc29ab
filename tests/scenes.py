"""Small scenes made up for the tests, and the way to the real ones where a machine has them."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from tsplat.scene import SH_COEFFICIENTS, Gaussians


def random_gaussians(rng: np.random.Generator, n: int, sh_degree: int = 3) -> Gaussians:
    """Return a cloud of radius about 1 around the origin, in view from z = -4.

    Opacities cover 0 to 1, scales 0.005 to 0.2 differ along each axis, rotations and colours are random.
    """
    means = rng.normal(0.0, 0.45, (n, 3))
    means /= np.maximum(1.0, np.linalg.norm(means, axis=1, keepdims=True))
    quats = rng.normal(size=(n, 4))
    quats /= np.linalg.norm(quats, axis=1, keepdims=True)
    scales = np.exp(rng.uniform(np.log(0.005), np.log(0.2), (n, 3)))
    opacities = rng.uniform(0.0, 1.0, n)
    # Higher bands get weaker, as in trained scenes, so that most colours stay inside [0, 1].
    spread = np.concatenate([np.full(2 * degree + 1, 0.8 / (1 + degree) ** 2) for degree in range(5)])
    k = SH_COEFFICIENTS[sh_degree]
    sh = rng.normal(size=(n, k, 3)) * spread[:k, None]
    return Gaussians(
        means.astype(np.float32),
        quats.astype(np.float32),
        scales.astype(np.float32),
        opacities.astype(np.float32),
        sh.astype(np.float32),
    )


def field_files() -> Path:
    """Return the folder of files that people had and that failed, beside the real scenes; it may not be there."""
    return (shared_scenes() or Path("none", "scenes")).parent / "field"


def shared_scenes() -> Path | None:
    """Return the folder of real scenes: TSPLAT_SCENES, or ``../shared/scenes`` beside the checkout."""
    beside = Path(__file__).resolve().parents[1].parent / "shared" / "scenes"
    folder = Path(os.environ.get("TSPLAT_SCENES", beside))
    return folder if folder.is_dir() else None
