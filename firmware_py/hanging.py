"""Mends cells that hang (stuck.py), in the stroke and in the press before it; loaded when some do.

Of the press logarithms alone are left, but what a cell added to them is known: it read the same all along.
"""

from firmware_py import constant, features, fixed, geometry, press, profile, stuck

const = constant.const

_near = stuck.near
_ln = fixed.ln
_exp = fixed.exp
_ratio = fixed.ratio

AWAY = const(384)  # eighths of a count: the neighbours' mean must once be further from a cell that hangs
TOLD = (
    geometry.MASK_BYTES
)  # where in `found` the first mended cells are: index, and two readings of the first
READINGS = const(3)  # bin in eighths of a count, its own and its neighbours'
MOST = const(25)  # so many of them
_CELLS = geometry.CELLS
_ROWS = geometry.ROWS
_COLUMNS = geometry.COLUMNS
_KEPT = press.KEPT
_MIDDLE = profile.MIDDLE
_SHIFT = profile.SPREAD_SHIFT
_LN_SPREAD = features.LN_SPREAD
_LN_SHARE = features.LN_SHARE
_LN_HALF_PITCH = features.LN_HALF_PITCH
_ONE = const(0x1000000)
_LN_ONE = const(279097920)  # ln 2^24
_LN_Q20 = const(232581600)  # ln 2^20
_LARGEST = const(4194304)  # a quarter: where a cell is more of the image, nothing presses yet


def mend(cells, slot, n, counts, dead, found):
    """Give each cell that hangs the mean of its live neighbours in the row, in all n bins.

    What keeps still as its neighbours do is left as it is: nothing presses there. dead: mask of the known
    dead cells; found: what stuck.find has filled, and from TOLD on what was mended. Returns how many were.
    """
    total = 0
    at = TOLD
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
        if a >= 0 and not _near(cells, slot, n, counts, i, a, b, AWAY):
            total += 1
            for k in range(n):
                base = slot[k] * _CELLS
                v = cells[base + i]
                w = (cells[base + a] + cells[base + b]) >> 1
                cells[base + i] = w
                if not k and total <= MOST:
                    c = counts[slot[k]]
                    found[at] = i
                    found[at + 1] = v * 8 // c
                    found[at + 2] = w * 8 // c
                    at += READINGS
    return total


def change(v, part, by):
    """ln(exp(v) + part) - by - v; part is Q20."""
    return _ln(_exp(v, 4) + part) - _LN_Q20 - by - v


def swap(kept, n, row, was, now):
    """Put a reading in the place of another in this row, in n kept frames of a press; both in 1/128 counts.

    `was` is that of a cell that hung in all of them, `now` what it would have read in the last; before, it
    would have been as much of the image.
    """
    a = 2 * row - _ROWS + 1
    last = 4 * _COLUMNS * _exp(kept[_KEPT * n - _KEPT], 24)
    for at in range(0, _KEPT * n, _KEPT):
        part = _ratio(now, last) - _ratio(was, 4 * _COLUMNS * _exp(kept[at], 24))
        if -_LARGEST < part < _LARGEST:
            by = _ln(_ONE + part) - _LN_ONE
            part >>= 4
            kept[at] += by
            v = (kept[at + 2] - _LN_HALF_PITCH << 1) - _LN_SPREAD
            kept[at + 2] += change(v, (part >> _SHIFT) * a * a, by) >> 1
            v = kept[at + 3] - _LN_SHARE
            kept[at + 3] += change(v, part if -_MIDDLE < a < _MIDDLE else 0, by)


def mend_press(kept, n, found, total, offset, gain):
    """Take out of n kept frames what `mend` told of `total` cells; offset, gain: the calibration's."""
    at = TOLD
    for _ in range(min(total, MOST)):
        i = found[at]
        was = (found[at + 1] - offset[i]) * gain[i] >> 9
        now = (found[at + 2] - offset[i]) * gain[i] >> 9
        swap(kept, n, i // _COLUMNS, was, now)
        at += READINGS
