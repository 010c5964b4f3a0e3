"""Takes cells that hang (stuck.py) out of the press before a stroke; loaded when there are some.

Of the press logarithms alone are left, but what such a cell added to them is known: it read the same all
along. In its place comes what it would have read: as much of the image as where it was mended.
"""

from firmware_py import constant, features, fixed, geometry, pipeline, press, profile

const = constant.const

_ln = fixed.ln
_exp = fixed.exp
_mul = fixed.mul
_ratio = fixed.ratio

_KEPT = press.KEPT
_ROWS = geometry.ROWS
_COLUMNS = geometry.COLUMNS
_MIDDLE = profile.MIDDLE
_SHIFT = profile.SPREAD_SHIFT
_OUTER = pipeline.OUTER
_LN_SPREAD = features.LN_SPREAD
_LN_SHARE = features.LN_SHARE
_LN_HALF_PITCH = features.LN_HALF_PITCH
_ONE = const(0x1000000)
_HALF = const(0x800000)
_LN_ONE = const(279097920)  # ln 2^24
_LN_Q20 = const(232581600)  # ln 2^20
_MOST = const(0x4000000)  # 4: of a cell's part of a share; 64 of the spread


def add(sums, i, v):
    """Add cell i that reads v (1/128 count) to an image's sums as press.look makes them, Q5 counts.

    They are: all, spread, middle rows, and the outer columns of these.
    """
    v //= 4 * _COLUMNS
    a = 2 * (i // _COLUMNS) - _ROWS + 1
    sums[0] += v
    sums[1] += v * a * a >> _SHIFT
    if -_MIDDLE < a < _MIDDLE:
        sums[2] += v
        if not _OUTER <= i % _COLUMNS < _COLUMNS - _OUTER:
            sums[3] += v * _COLUMNS * _ROWS // (2 * _MIDDLE * _OUTER)


def mended(p):
    """What pipeline.Pipeline p has kept of its press, mended, in memory that its next stroke writes over."""
    out = p._work  # what was felt stays: another stroke may follow the same press
    first = p._slot[0] * geometry.CELLS
    hung = p.hung[: 2 * p.stuck]
    mend(p.press.kept, p.press.n, hung, p.calibration, p.bins.cells, first, p._force[0], out)
    return out


def parts(sums, total):
    """Those sums over an image's own: Q24, the spread's Q20."""
    return [_ratio(sums[j] >> 4 if j == 1 else sums[j], total) for j in range(4)]


def mend(kept, n, hung, calibration, cells, base, force, out):
    """Write the n kept frames of a press into `out` as if these cells had not hung.

    hung: which, and their readings (stuck.mend); cells[base:]: the calibrated bin of the stroke that says
    how much of the image they are, whose sum `force` is (Q5 counts).
    """
    was = [0] * 4
    now = [0] * 4
    for k in range(0, len(hung), 2):
        i = hung[k]
        add(was, i, (hung[k + 1] - calibration.offset[i]) * calibration.gain[i] >> 9)
        add(now, i, max(cells[base + i] - 4096, 0) << 4)
    come = parts(now, force)
    for at in range(0, _KEPT * n, _KEPT):
        for j in range(_KEPT):
            out[at + j] = kept[at + j]
        gone = parts(was, _exp(kept[at], 24))
        # a frame that these cells were half of, nothing pressed in yet
        if max(gone) < _MOST and min(gone) > -_MOST and max(abs(gone[0]), come[0]) < _HALF:
            f = _ratio(_ONE - come[0], _ONE - gone[0])
            out[at] -= _ln(f) - _LN_ONE
            v = (kept[at + 2] - _LN_HALF_PITCH << 1) - _LN_SPREAD
            v = _ln(_mul(_exp(v, 4) - gone[1], f) + come[1]) - _LN_Q20
            out[at + 2] = (v + _LN_SPREAD >> 1) + _LN_HALF_PITCH
            v = _mul(_exp(kept[at + 3] - _LN_SHARE, 0) - gone[2], f) + come[2]
            out[at + 3] = _ln(v) - _LN_ONE + _LN_SHARE
            out[at + 4] = _mul(kept[at + 4] - gone[3], f) + come[3]
