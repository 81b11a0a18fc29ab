"""What passes between those who find splats in a glTF and those who place them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tsplat.io.arrays import Arrays

Fill = Callable[[Arrays, Callable[[float], None]], None]


@dataclass(frozen=True, slots=True)
class Primitive:
    """Splats that are there to be read.

    Attributes
    ----------
    count, coefficients : int
        How many, and of how many harmonics their colours are made.
    fill : callable
        Writes them to arrays of that size, in the axes of the mesh, and calls its second argument with the
        fraction done; opacities may lie outside of 0 to 1.
    antialiased : bool
        As in `Gaussians`.
    """

    count: int
    coefficients: int
    fill: Fill
    antialiased: bool = False
