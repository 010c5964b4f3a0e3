"""The stroke relative to the lump: images and depth at every millimetre from its middle, both sides folded.

Beyond the lump the probe's image is mirrored, so that "towards the lump" is one direction. All sums
are over both sides. One array holds them; the constants say where.
"""

from firmware_py import constant, geometry, traces

const = constant.const

_weigh = traces.weigh
_at = traces.at

_ROWS = geometry.ROWS
_HALF = geometry.HALF_ROWS
_MIDDLE_UM = 3000  # the middle sensors are those less than so far from the middle
MIDDLE = geometry.rows_within(_MIDDLE_UM)
OUTERMOST = max(1, 3000 // geometry.PITCH_UM)  # sensors at either end: 3 mm of the face
SPREAD_SHIFT = 3 * ((_ROWS - 1) // 16)  # what keeps SPREAD in range where there are more than 16 rows
_REACH = const(34)  # mm on either side of the lump: each profile holds the places 0..34 mm
CENTRE = const(0)  # the MIDDLE sensors, Q5 counts
DEPTH = const(35)  # 1/16 um
TOTAL = const(70)  # the whole image, Q5 counts
TILT = const(105)  # sum of pressure times the place in half pitches: positive away from the lump
SPREAD = const(140)  # sum of pressure times the square of that, less SPREAD_SHIFT bits
FAR = const(175)  # image 24..33 mm away, folded about its own middle: outermost first
NEAR = FAR + _HALF  # image within 2 mm
AT_28 = NEAR + _HALF  # image 26..30 mm away
SIZE = AT_28 + _HALF


def measure(x_um, n, rows, depth, centre_um, out, w):
    """Fill `out` (SIZE numbers) from the n bins; w: working space of 4 numbers and the rows."""
    for i in range(SIZE):
        out[i] = 0
    k = 0
    for j in range(-_REACH, _REACH + 1):
        x = centre_um + 1000 * j
        while k < n - 2 and x_um[k + 1] <= x:
            k += 1
        _weigh(x_um, n, k, x, w)
        add_place(rows, depth, k, n, j, out, w)


def add_place(rows, depth, k, n, j, out, w):
    """Add what is j mm from the middle, in interval k with the weights in w, which gets the image too."""
    m = j if j >= 0 else -j
    both = 2 if j == 0 else 1
    out[DEPTH + m] += both * _at(depth, 1, 0, k, n, w)
    centre = 0
    total = 0
    tilt = 0
    spread = 0
    for i in range(_ROWS):
        w[4 + i] = _at(rows, _ROWS, i, k, n, w)
    a = _ROWS - 1
    for i in range(_HALF):
        v = w[4 + i]
        u = w[3 + _ROWS - i]
        tilt += (u - v) * a
        v += u
        total += v
        if a < MIDDLE:
            centre += v
        spread += v * a * a >> SPREAD_SHIFT
        a -= 2
    out[CENTRE + m] += both * centre
    out[TOTAL + m] += both * total
    if j:
        # seen from the left the lump lies at positive s
        out[TILT + m] += tilt if j > 0 else -tilt
    out[SPREAD + m] += both * spread
    if 24 <= m <= 33:
        _fold(w, out, FAR, 1)
    if m <= 2:
        _fold(w, out, NEAR, both)
    if 26 <= m <= 30:
        _fold(w, out, AT_28, 1)


def _fold(w, out, at, times):
    """Add the image in w[4..], folded, to out[at..]."""
    for i in range(_HALF):
        out[at + i] += times * (w[4 + i] + w[3 + _ROWS - i])


def window(out, start, low, high):
    """Sum of one profile over low..high mm."""
    s = 0
    for i in range(start + low, start + high + 1):
        s += out[i]
    return s
