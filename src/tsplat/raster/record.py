"""The record of a visible splat: the columns of one row of 16 float32, which is one cache line.

``log2(alpha) = CONIC_A dx^2 + CONIC_B dx dy + CONIC_C dy^2 + LOG2_OPACITY``, drawn where that is at least
LOG2_CUT; dx and dy count from X and Y, which count from the centre of the first pixel.

At the height dy, what is drawn reaches from ``SLOPE dy - h`` to ``SLOPE dy + h`` beside X, where
``h^2 = HALF_WIDTH2 - NARROWING dy^2``; farthest right at dy = RIGHTMOST, farthest left at -RIGHTMOST.
"""

LENGTH = 16

X, Y = 0, 1
CONIC_A, CONIC_B, CONIC_C = 2, 3, 4
LOG2_OPACITY, LOG2_CUT = 5, 6
RED, GREEN, BLUE = 7, 8, 9
DEPTH = 10
SLOPE, HALF_WIDTH2, NARROWING, RIGHTMOST = 11, 12, 13, 14
