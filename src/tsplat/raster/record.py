"""The record of a visible splat: the columns of one row of 16 float32, which is one cache line.

``level = CONIC_A dx^2 + CONIC_B dx dy + CONIC_C dy^2 + PEAK``, drawn where that is at least CUT, with the alpha
that `falloff` makes of it; dx and dy count from X and Y, which count from the centre of the first pixel.

At the height dy, what is drawn reaches from ``SLOPE dy - h`` to ``SLOPE dy + h`` beside X, where
``h^2 = HALF_WIDTH2 - NARROWING dy^2``; farthest right at dy = RIGHTMOST, farthest left at -RIGHTMOST.
"""

LENGTH = 16

X, Y, SLOPE, HALF_WIDTH2, NARROWING, RIGHTMOST = range(6)
"""All that `cells` asks for lies in the first half."""

PEAK, CUT = 6, 7
CONIC_A, CONIC_B, CONIC_C = 8, 9, 10
RED, GREEN, BLUE = 11, 12, 13
DEPTH = 14
