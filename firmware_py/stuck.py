"""Cells at a rail. Those that died after the calibration stand there wherever the probe is, and are mended.

A live cell never reads 0, since its unloaded reading is some counts above it, and does not read full scale
both beside the lump and over it. Several at full scale in one place are pressed harder than they can say.
"""

from firmware_py import geometry

LOOKS = 5  # bins looked at, evenly spread over the stroke
_CELLS = geometry.CELLS
_COLUMNS = geometry.COLUMNS
FULL = 4  # live cells at full scale in one bin: the top of a bump is cut off
CLEAR = 64  # a cell whose zero lies under 8 counts may well read 0


def stands(cells, slot, n, counts, offset, i):
    """1 if cell i stands at a rail in every bin looked at."""
    low = 1 if offset[i] >= CLEAR else 0
    high = 1
    for j in range(LOOKS):
        s = slot[j * (n - 1) // (LOOKS - 1)]
        v = cells[s * _CELLS + i]
        if v:
            low = 0
        if v != geometry.FULL_COUNT * counts[s]:
            high = 0
        if not low and not high:
            return 0
    return 1


def mend(cells, slot, n, counts, offset, dead, found):
    """Give each cell that stands at a rail the mean of its live neighbours in the row, in all n bins.

    dead: mask of the known dead cells, which are left alone; found: gets the others. Returns how many.
    """
    total = 0
    for i in range(geometry.MASK_BYTES):
        found[i] = 0
    for i in range(_CELLS):
        if not (dead[i >> 3] >> (i & 7)) & 1 and stands(cells, slot, n, counts, offset, i):
            found[i >> 3] |= 1 << (i & 7)
            total += 1
    if not total:
        return 0
    for i in range(_CELLS):
        if not (found[i >> 3] >> (i & 7)) & 1:
            continue
        col = i % _COLUMNS
        a = -1
        b = -1
        for k in range(1, _COLUMNS):
            c = i - k
            if a < 0 and col >= k and not ((dead[c >> 3] | found[c >> 3]) >> (c & 7)) & 1:
                a = c
            c = i + k
            if b < 0 and col + k < _COLUMNS and not ((dead[c >> 3] | found[c >> 3]) >> (c & 7)) & 1:
                b = c
        if a < 0:
            a = b
        if b < 0:
            b = a
        if a >= 0:
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
