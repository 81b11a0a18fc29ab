"""The record of a visible splat: the columns of one row of 8 float32, half a cache line.

``level = CONIC_A dx^2 + CONIC_B dx dy + CONIC_C dy^2 + PEAK``, with the alpha that `falloff` makes of it;
dx and dy count from X and Y, which count from the centre of the first pixel.

COLOR and the column behind it hold half-precision numbers: red, green, blue and nothing.
"""

LENGTH = 8

X, Y = 0, 1
CONIC_A, CONIC_B, CONIC_C = 2, 3, 4
PEAK = 5
COLOR = 6
