"""The sensor array in numbers, all worked out from sensor_array.py; everybody else takes them from here.

A frame holds the cells row by row, two counts of 12 bits in three bytes: the first's low eight bits, then its
high four with the second's low four above them, then the second's high eight (`bins.put_cells`).
Lengths in um, pressures in Pa.
"""

from firmware_py import sensor_array

ROWS = sensor_array.ROWS  # along the stroke
COLUMNS = sensor_array.COLUMNS  # across it
PITCH_UM = sensor_array.PITCH_UM
FULL_SCALE_PA = sensor_array.FULL_SCALE_PA
PEDESTAL_PA = sensor_array.PEDESTAL_PA

CELLS = ROWS * COLUMNS
HALF_ROWS = ROWS // 2
BITS = 12
FULL_COUNT = (1 << BITS) - 1
FRAME_BYTES = CELLS * BITS // 8
MASK_BYTES = CELLS // 8  # one bit a cell
LENGTH_UM = ROWS * PITCH_UM  # the face, along the stroke
WIDTH_UM = COLUMNS * PITCH_UM
FIRST_ROW_UM = -(LENGTH_UM - PITCH_UM) // 2  # middle of the first row, from the face's middle
COUNT_MPA = (FULL_SCALE_PA * 1000 + FULL_COUNT // 2) // FULL_COUNT  # nominal, millipascal
COUNTS_A_100_PA = FULL_COUNT * CELLS // (FULL_SCALE_PA // 100)  # sum of all cells' counts
PEDESTAL_COUNTS = (PEDESTAL_PA * FULL_COUNT + FULL_SCALE_PA // 2) // FULL_SCALE_PA


def name(rows, columns, pitch_um):
    """What an array is called, in the handshake's refusals and by a model image that is for it."""
    return "%dx%d at %d um" % (rows, columns, pitch_um)


NAME = name(ROWS, COLUMNS, PITCH_UM).encode()


def rows_within(um):
    """How many rows lie less than so far from the face's middle; always at least the middle two."""
    n = 2
    while n < ROWS and (n + 1) * PITCH_UM < 2 * um:
        n += 2
    return n


def between(um):
    """Where |s| = um lies between two rows: index of the outer one (0: the outermost), its weight, the sum
    of both weights, in lowest terms so that products stay small.
    """
    i = 0
    while i < HALF_ROWS - 1 and -FIRST_ROW_UM - i * PITCH_UM > um:
        i += 1
    i = i - 1 if i else 0
    weight = um - (-FIRST_ROW_UM - (i + 1) * PITCH_UM)
    total = PITCH_UM
    a = weight
    b = total
    while a:
        a, b = b % a, a
    weight //= b
    total //= b
    if total > 256:
        weight = (weight * 256 + total // 2) // total
        total = 256
    return i, weight, total
