"""The stroke seen from the lump: images and depth at every millimetre from its middle, both sides folded.

Beyond the lump the probe's image is mirrored, so that "towards the lump" is one direction. All sums
are over both sides. One array holds them; the constants say where.
"""

from firmware_py import traces

_weigh = traces.weigh
_at = traces.at

REACH = 34
LENGTH = 35  # places 0..34 mm from the middle
CENTRE = 0  # the four middle sensors, Q5 counts
DEPTH = 35  # 1/16 um
TOTAL = 70  # the whole image, Q5 counts
TILT = 105  # sum of pressure times (2 i - 15): positive away from the lump
SPREAD = 140  # sum of pressure times (2 i - 15)^2
FAR = 175  # image 24..33 mm away, folded about its own middle: outermost first, 8 values
NEAR = 183  # image within 2 mm
AT_28 = 191  # image 26..30 mm away
SIZE = 199


def measure(x_um, n, rows, depth, centre_um, out, w):
    """Fill `out` (SIZE numbers) from the n bins; w: working space of 20 numbers."""
    for i in range(199):
        out[i] = 0
    k = 0
    for j in range(-34, 35):
        x = centre_um + 1000 * j
        while k < n - 2 and x_um[k + 1] <= x:
            k += 1
        _weigh(x_um, n, k, x, w)
        m = j if j >= 0 else -j
        both = 2 if j == 0 else 1
        out[35 + m] += both * _at(depth, 1, 0, k, n, w)
        centre = 0
        total = 0
        tilt = 0
        spread = 0
        a = -15
        for i in range(16):
            v = _at(rows, 16, i, k, n, w)
            w[4 + i] = v
            total += v
            v *= a
            tilt += v
            spread += v * a
            if -4 < a < 4:
                centre += w[4 + i]
            a += 2
        out[m] += both * centre
        out[70 + m] += both * total
        if j:
            # seen from the left the lump lies at positive s
            out[105 + m] += tilt if j > 0 else -tilt
        out[140 + m] += both * spread
        if 24 <= m <= 33:
            _fold(w, out, 175, 1)
        if m <= 2:
            _fold(w, out, 183, both)
        if 26 <= m <= 30:
            _fold(w, out, 191, 1)


def _fold(w, out, at, times):
    """Add the image in w[4..19], folded, to out[at..at+7]."""
    for i in range(8):
        out[at + i] += times * (w[4 + i] + w[19 - i])


def window(out, start, low, high):
    """Sum of one profile over low..high mm."""
    s = 0
    for i in range(start + low, start + high + 1):
        s += out[i]
    return s
