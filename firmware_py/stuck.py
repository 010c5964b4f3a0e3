"""Cells that died after the calibration: they stand at a rail wherever the probe is; mended for the stroke.

A live cell never reads 0, since its unloaded reading is some counts above it, and does not read full scale
both beside the lump and over it.
"""

LOOKS = 5  # bins looked at, evenly spread over the stroke
CLEAR = 64  # a cell whose zero lies under 8 counts may well read 0


def stands(cells, slot, n, counts, offset, i):
    """1 if cell i stands at a rail in every bin looked at."""
    low = 1 if offset[i] >= CLEAR else 0
    high = 1
    for j in range(LOOKS):
        s = slot[j * (n - 1) // (LOOKS - 1)]
        v = cells[s * 416 + i]
        if v:
            low = 0
        if v != 4095 * counts[s]:
            high = 0
        if not low and not high:
            return 0
    return 1


def mend(cells, slot, n, counts, offset, dead, found):
    """Give each cell that stands at a rail the mean of its live neighbours in the row, in all n bins.

    dead: mask of the known dead cells, which are left alone; found: gets the others. Returns how many.
    """
    total = 0
    for i in range(52):
        found[i] = 0
    for i in range(416):
        if not (dead[i >> 3] >> (i & 7)) & 1 and stands(cells, slot, n, counts, offset, i):
            found[i >> 3] |= 1 << (i & 7)
            total += 1
    if not total:
        return 0
    for i in range(416):
        if not (found[i >> 3] >> (i & 7)) & 1:
            continue
        col = i % 26
        a = -1
        b = -1
        for k in range(1, 26):
            c = i - k
            if a < 0 and col >= k and not ((dead[c >> 3] | found[c >> 3]) >> (c & 7)) & 1:
                a = c
            c = i + k
            if b < 0 and col + k < 26 and not ((dead[c >> 3] | found[c >> 3]) >> (c & 7)) & 1:
                b = c
        if a < 0:
            a = b
        if b < 0:
            b = a
        if a >= 0:
            for k in range(n):
                base = slot[k] * 416
                cells[base + i] = (cells[base + a] + cells[base + b]) >> 1
    return total
