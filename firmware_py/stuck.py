"""Cells that hang: they read the same wherever the probe is, at a rail or anywhere else, and are mended.

A live cell never keeps so still where anything presses, since its noise alone is more. Several at full scale
in one place are pressed harder than they can say.
"""

from firmware_py import constant, geometry

const = constant.const

_CELLS = geometry.CELLS
_COLUMNS = geometry.COLUMNS
FULL = 4  # live cells at full scale in one bin: the top of a bump is cut off
STILL = 24  # eighths of a count that a hanging cell may stray from its first reading
AWAY = 384  # its neighbours' mean must once be so far from it,
MOVED = 192  # or from what it was itself: else nothing presses there
MOST = const(24)  # of so many cells the readings are kept, for the press before the stroke (hanging.py)


def near(cells, slot, n, counts, c, d, a, b, most):
    """1 if the mean of cells a and b keeps within `most` (1/8 count) of that of c and d in the first bin."""
    k = slot[0]
    # not the sum times 4: unsigned numbers stay unsigned once compiled
    first = (cells[k * _CELLS + c] * 4 + cells[k * _CELLS + d] * 4) // counts[k]
    for j in range(n):
        k = slot[j]
        v = (cells[k * _CELLS + a] * 4 + cells[k * _CELLS + b] * 4) // counts[k] - first
        if v > most or v < -most:
            return 0
    return 1


def mend(cells, slot, n, counts, dead, found, hung):
    """Give each cell that hangs the mean of its live neighbours in the row, in all n bins.

    dead: mask of the known dead cells, which are left alone; found: working space, a number for each of its
    bytes; hung: gets index and reading (1/8 count) of the first MOST cells. Returns how many there are.
    """
    for i in range(_CELLS):
        if not i & 7:
            found[i >> 3] = dead[i >> 3]
        if near(cells, slot, n, counts, i, i, i, i, STILL):
            found[i >> 3] |= 1 << (i & 7)
    total = 0
    for i in range(_CELLS):
        if not ((found[i >> 3] & ~dead[i >> 3]) >> (i & 7)) & 1:
            continue
        a = -1
        b = -1
        row = i - i % _COLUMNS
        for c in range(row, row + _COLUMNS):
            if not (found[c >> 3] >> (c & 7)) & 1:
                if c < i:
                    a = c
                elif b < 0:
                    b = c
        if a < 0:
            a = b
        if b < 0:
            b = a
        if a < 0 or (
            near(cells, slot, n, counts, i, i, a, b, AWAY) and near(cells, slot, n, counts, a, b, a, b, MOVED)
        ):
            continue
        if total < MOST:
            hung[2 * total] = i
            hung[2 * total + 1] = cells[slot[0] * _CELLS + i] * 8 // counts[slot[0]]
        total += 1
        for k in range(n):
            base = slot[k] * _CELLS
            cells[base + i] = (cells[base + a] + cells[base + b]) >> 1
    return total


def full(cells, base, most, dead):
    """How many live cells of the bin at cells[base:] have the sum `most`, which nothing exceeds."""
    total = 0
    for i in range(_CELLS):
        if cells[base + i] >= most and not (dead[i >> 3] >> (i & 7)) & 1:
            total += 1
    return total
