"""Cells that hang: they read the same wherever the probe is, at a rail or elsewhere; hanging.py mends them.

A live cell is never so still, since its noise alone is more, unless nothing presses on it. Several at full
scale in one place are pressed harder than they can say.
"""

from firmware_py import geometry

_CELLS = geometry.CELLS
FULL = 4  # live cells at full scale in one bin: the top of a bump is cut off
STILL = 24  # eighths of a count that a hanging cell may stray from its first reading


def near(cells, slot, n, counts, i, a, b, most):
    """1 if the mean of cells a and b stays within `most` eighths of a count of cell i's first reading."""
    first = cells[slot[0] * _CELLS + i] * 8 // counts[slot[0]]
    for k in range(1, n):
        s = slot[k]
        # not the sum times 4: unsigned numbers stay unsigned once compiled
        v = (cells[s * _CELLS + a] * 4 + cells[s * _CELLS + b] * 4) // counts[s] - first
        if v > most or v < -most:
            return 0
    return 1


def find(cells, slot, n, counts, dead, found):
    """Mark in `found` each cell that keeps still in all n bins; returns how many do.

    dead: mask of the known dead cells, which are left alone; found: a number for each of its bytes.
    """
    total = 0
    for i in range(_CELLS):
        if not i & 7:
            found[i >> 3] = 0
        if not (dead[i >> 3] >> (i & 7)) & 1 and near(cells, slot, n, counts, i, i, i, STILL):
            found[i >> 3] |= 1 << (i & 7)
            total += 1
    return total


def full(cells, base, most, dead):
    """How many live cells of the bin at cells[base:] have the sum `most`, which nothing exceeds."""
    total = 0
    for i in range(_CELLS):
        if cells[base + i] >= most and not (dead[i >> 3] >> (i & 7)) & 1:
            total += 1
    return total
