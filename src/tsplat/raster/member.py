"""A record that is being blended: the columns of one row of 16 float32, the first six as in `record`.

It is drawn where its level is at least CUT.
"""

LENGTH = 16

X, Y = 0, 1
CONIC_A, CONIC_B, CONIC_C = 2, 3, 4
PEAK = 5

UNPACKED = 8
"""Here the second half of the record is put as eight half-precision numbers, some of them without meaning."""

CUT, DEPTH = 8, 9
RED, GREEN, BLUE = 12, 13, 14
