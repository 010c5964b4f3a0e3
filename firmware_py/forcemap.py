"""The force map: moves each frame to the stroke's mean force, as if the hand had pressed steadily.

The map gives d p_s / d ln F (a value a row, in units of the image's mean) and d ln D / d ln F from the
image itself: linear in the relative pressures p / mean(p) - 1, quadratic in ln F and ln D. Layers and
probe are symmetric, so it works on the image's even and odd halves apart, with half of the numbers. A frame
takes two steps, the second with the map evaluated half way (midpoint rule). Learned from
finite-element strokes at two forces by `palpate.model_export.integers.force_map`.

Blob, little endian: "F", version, shift of the coefficients' Q format, 0; ln F centre and ln D
centre (int32, Q24, of the image sum in Q5 counts and of the displacement in 1/16 um; 0 there is for a map of
the pressure alone); then int16, input by input (for 16 rows, 14 x 9 even coefficients and 8 x 8 odd ones).
"""

from array import array

from firmware_py import fixed, geometry

_ln = fixed.ln
_mul = fixed.mul
_exp = fixed.exp

VERSION = 2
_ROWS = geometry.ROWS
_HALF = geometry.HALF_ROWS
EVEN_IN = 6 + _HALF  # 1, lnF, lnD, lnF^2, lnF lnD, lnD^2, the even pressures
EVEN_OUT = _HALF + 1  # even pressures, ln D
COEFS = EVEN_IN * EVEN_OUT + _HALF * _HALF
HEAD = 3  # numbers of the unpacked map before the coefficients
BLOB_BYTES = 12 + 2 * COEFS
# working space: even inputs, odd pressures, even outputs, the image
_ODD = EVEN_IN
_OUT = _ODD + _HALF
_IMAGE = _OUT + EVEN_OUT
WORK = _IMAGE + _ROWS
_FIRST_ODD = HEAD + EVEN_IN * EVEN_OUT
_TWO = 0x2000000
MOST = 0x1FFFF  # a row, Q5 counts: full scale
DEEPEST = 0x1FFFFF  # a depth, 1/16 um
STEEPEST = 0x1FFFFF  # 8 in Q18
# Relative pressures are within +-2 (Q13) on a face that is pressed all along, as the reference's 24 mm; on a
# longer one fewer rows bear the force, and each bears more of it
_RELATIVE_Q = 13
_long = 30000
while _long < geometry.LENGTH_UM and _RELATIVE_Q > 10 and _HALF <= 1 << (_RELATIVE_Q - 7):  # sums below 2^30
    _RELATIVE_Q -= 1
    _long *= 2


def load(blob):
    """The blob as array('i'): shift, centres, coefficients; None if it is not a force map of this version."""
    if len(blob) != BLOB_BYTES or blob[0] != 0x46 or blob[1] != VERSION or not 12 <= blob[2] <= 14 or blob[3]:
        return None
    out = array("i", bytes(4 * (HEAD + COEFS)))
    out[0] = blob[2]
    for k in range(2):
        p = 4 + 4 * k
        top = blob[p + 3]
        if 31 < top < 224:
            return None
        if top > 127:
            top -= 256
        # multiplied, not shifted: 2^29 and its negative pass through small integers only
        out[1 + k] = top * 0x1000000 + (blob[p] | blob[p + 1] << 8 | blob[p + 2] << 16)
    p = 12
    for k in range(COEFS):
        v = blob[p] | blob[p + 1] << 8
        out[HEAD + k] = v - 65536 if v > 32767 else v
        p += 2
    return out


def limit(v, most):
    """v held within +-most."""
    if v > most:
        return most
    if v < -most:
        return -most
    return v


def slopes(f, w, lf, ld, total):
    """Evaluate the map f for the image at w[_IMAGE] with sum `total`; outputs from w[0] on, Q18.

    lf, ld: ln F and ln D less their centres, Q12 (held within +-4); relative pressures go in as
    Q13, within +-2 (a long face: Q12, +-4 or Q11, +-8). Image sensor s gets w[s], displacement w[ROWS].
    """
    last = _ROWS - 1
    up = _RELATIVE_Q - 1
    mean = (total + _HALF) // _ROWS
    half = mean >> 1
    w[0] = 4096
    w[1] = limit(lf, 16383)
    w[2] = limit(ld, 16383)
    w[3] = limit((w[1] * w[1] + 2048) >> 12, 16383)
    w[4] = limit((w[1] * w[2] + 2048) >> 12, 16383)
    w[5] = limit((w[2] * w[2] + 2048) >> 12, 16383)
    for i in range(_HALF):
        a = w[_IMAGE + i]
        b = w[_IMAGE + last - i]
        w[6 + i] = limit(((limit(a + b - 2 * mean, 250000) << up) + half) // mean, 16383)
        w[_ODD + i] = limit(((limit(a - b, 250000) << up) + half) // mean, 16383)
    down = f[0] - 12
    shift = _RELATIVE_Q - 6
    for j in range(EVEN_OUT):
        s = 0
        k = 3 + j
        for i in range(6):
            s += w[i] * f[k] >> 6
            k += EVEN_OUT
        for i in range(6, EVEN_IN):
            s += w[i] * f[k] >> shift
            k += EVEN_OUT
        w[_OUT + j] = limit(s >> down, STEEPEST)
    # the inputs are no longer needed: outputs take their places
    for j in range(_HALF):
        s = 0
        k = _FIRST_ODD + j
        for i in range(_HALF):
            s += w[_ODD + i] * f[k] >> shift
            k += _HALF
        w[j] = s >> down
    for j in range(_HALF):
        a = w[_OUT + j]
        b = w[j]
        w[j] = limit(a + b, STEEPEST)
        w[last - j] = limit(a - b, STEEPEST)
    w[_ROWS] = w[_OUT + _HALF]


def carry(rows, at, step, w, out, to):
    """The image rows[at..] moved by step (u times its sum) along the slopes w, into out[to..]; its sum."""
    total = 0
    for i in range(_ROWS):
        v = limit(rows[at + i] + ((_mul(step, w[i] << 6) + _HALF) // _ROWS), MOST)
        out[to + i] = v
        total += v
    return total


def move(f, rows, at, depth, u, w):
    """Move the image rows[at..at+ROWS) (Q5 counts) and depth (1/16 um) by u = ln(force wanted / force), Q24.

    Returns the new depth.
    """
    total = 0
    for i in range(_ROWS):
        v = rows[at + i]
        w[_IMAGE + i] = v
        total += v
    alone = f[2] == 0  # a map of the pressure alone
    if total < 2048 or (depth < 16 and not alone):
        return depth
    if u > 11000000:
        u = 11000000
    elif u < -11000000:
        u = -11000000
    lf = (_ln(total) - f[1] + 2048) >> 12
    ld = 0 if alone else (_ln(depth) - f[2] + 2048) >> 12
    slopes(f, w, lf, ld, total)
    # half a step
    total = carry(rows, at, _mul(u >> 1, total), w, w, _IMAGE)
    if total < 2048:
        return depth
    slopes(f, w, lf + (u >> 13), ld + (_mul(u >> 1, w[_ROWS] << 6) >> 12), total)
    carry(rows, at, _mul(u, total), w, rows, at)
    if alone:
        return depth
    u = limit(_mul(u, w[_ROWS] << 6), _TWO)
    return limit(_mul(depth << 4, _exp(u, 4)), DEEPEST)
