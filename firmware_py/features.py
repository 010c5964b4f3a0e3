"""Features of a stroke, Q24 each, held at +-(2^29 - 1). The ids are the places in
feature_names.NAMES and stay as they are.

The first six are the thesis' (as logarithms or ratios); docs/features.md gives every formula.
"""

from firmware_py import constant, fixed, geometry, profile

const = constant.const

_ln = fixed.ln
_ratio = fixed.ratio
_mul = fixed.mul
_window = profile.window

# raised when features are added; what was there keeps its place and its meaning, so older models go on
FEATURES_VERSION = 5
COUNT = const(58)
# where each stands in the vector: their places in feature_names.NAMES; a test holds them equal
_LN_BASE = const(0)
_LN_AMP = const(1)
_LN_STDEV = const(2)
_INV_CURVATURE = const(3)
_LN_D28 = const(4)
_LN_D0 = const(5)
_LN_FORCE = const(6)
_ASINH_AMP = const(7)
_LN_D_FAR = const(8)
_DIP_6_10 = const(9)
_LN_CENTRE_SHARE = const(10)
_LN_MISFIT = const(11)
_ASINH_RISE = const(12)
_TRACE_7_9 = const(13)
_TRACE_12_16 = const(14)
_DIP_0_2 = const(15)
_DIP_3_5 = const(16)
_DIP_12_16 = const(17)
_DIP_17_22 = const(18)
_TRACE_3_5 = const(19)
_TRACE_17_22 = const(20)
_TILT_3_5 = const(21)
_TILT_6_9 = const(22)
_TILT_10_14 = const(23)
_LN_WIDTH_FAR = const(24)
_LN_WIDTH_NEAR = const(25)
_EDGE_FAR = const(26)
_LN_PEAK = const(27)
_TILT_15_19 = const(28)
_TILT_20_24 = const(29)
PRESS = const(30)  # the first nine of the press; those before it are version 1's
_BASE_SHARE = const(39)
PRESS_OUTER = const(40)  # three more of the press, version 3's
BUMP = const(43)  # it and the eleven behind it are version 4's
_PULL = const(44)
_LIFT = const(50)
ACROSS = const(55)  # it and the two behind it are version 5's
ACROSS_END = const(58)
# and of the Gaussian's parameters (gauss.py)
_BASE = const(0)
_AMP = const(1)
_STDEV = const(3)
_COST = const(4)

_LN2 = const(11629080)  # fixed.LN2
LN_COUNT_TO_KPA = -359705684  # ln(1 / (2^11 1e6)): Q11 counts of 1 mPa to kPa
_LN_PITCH = fixed.ln(geometry.PITCH_UM)
LN_SUM_TO_N_PER_M = _LN_PITCH - 405824108  # ln(pitch / (2^5 1e9)): sum of Q5 counts of 1 mPa to N/m
LN_DEPTH_TO_MM = -162409222  # ln(1 / 16e3)
LN_HALF_PITCH = _LN_PITCH - 127521983  # ln(pitch / 2000)
LESS_THAN_PITCH = 0x1000000 - ((geometry.PITCH_UM << 16) // 1000 << 7)  # 1 - half a pitch in mm
LN_SHARE = _ln(geometry.ROWS) - _ln(profile.MIDDLE)
LN_SPREAD = profile.SPREAD_SHIFT * _LN2
_HALF = geometry.HALF_ROWS
_OUTERMOST = profile.OUTERMOST
_AT_8_MM, _OUTER, _WEIGHTS = geometry.between(8000)
TENTH_PERMILLE = 1678  # 1e-4
ABSENT = -0x1FFFFFFF  # of a press that there was not, of columns not looked at: outside every domain
FLOOR = 16384  # the least base, Q11: 8 counts
_CHANGES = const(11)
_LEAST_CHANGE = const(110729)  # .0066 mm: in the sum beside them, so that noise alone stays small
_LN_CHANGES = _ln(_CHANGES)  # of an integer, as those of the sums
_MOST_LIFT = const(0x4000000)


def asinh_of(v, times):
    """asinh(times v) for a Q24 number v, however large the product."""
    a = v if v >= 0 else -v
    if a < 0x10000000 // times:
        return fixed.asinh(v * times)
    r = _ratio(0x1000000 // times, a)
    r = _ln(a) - 23 * _LN2 + _ln(times) + (_mul(r, r) >> 2)
    return r if v >= 0 else -r


def less_one(a, b):
    """a / b - 1 in Q24 for b > 0."""
    return _ratio(a - b, b)


def from_fit(p, n, out):
    """The features that the Gaussian alone decides; pressures still in units of the sensor's count."""
    base = p[_BASE] if p[_BASE] > FLOOR else FLOOR
    amp = p[_AMP]
    out[_LN_BASE] = _ln(base) + LN_COUNT_TO_KPA
    least = base >> 9
    out[_LN_AMP] = _ln(amp if amp > least else least) + LN_COUNT_TO_KPA
    out[_LN_STDEV] = _ln(p[_STDEV]) - 16 * _LN2
    out[_ASINH_AMP] = asinh_of(_ratio(amp, base), 100)
    out[_LN_MISFIT] = _ln(fixed.exp(((p[_COST] - _ln(n)) >> 1) - _ln(base), 0) + TENTH_PERMILLE) - 24 * _LN2


def from_profile(q, out):
    """The features of the folded profile (profile.measure)."""
    far = _window(q, profile.DEPTH, 24, 33)
    far = far if far > 320 else 320
    out[_LN_D28] = _ln(_window(q, profile.DEPTH, 26, 30) // 10) + LN_DEPTH_TO_MM
    out[_LN_D0] = _ln(_window(q, profile.DEPTH, 0, 2) // 6) + LN_DEPTH_TO_MM
    out[_LN_D_FAR] = _ln(far // 20) + LN_DEPTH_TO_MM
    out[_DIP_0_2] = dip(q, far, 0, 2)
    out[_DIP_3_5] = dip(q, far, 3, 5)
    out[_DIP_6_10] = dip(q, far, 6, 10)
    out[_DIP_12_16] = dip(q, far, 12, 16)
    out[_DIP_17_22] = dip(q, far, 17, 22)

    far = _window(q, profile.CENTRE, 24, 33)
    far = far if far > 2560 else 2560
    total = _window(q, profile.TOTAL, 24, 33)
    total = total if total > 10240 else 10240
    out[_LN_CENTRE_SHARE] = _ln(far) - _ln(total) + LN_SHARE
    out[_ASINH_RISE] = asinh_of(trace(q, far, 0, 2), 32)
    out[_TRACE_3_5] = trace(q, far, 3, 5)
    out[_TRACE_7_9] = trace(q, far, 7, 9)
    out[_TRACE_12_16] = trace(q, far, 12, 16)
    out[_TRACE_17_22] = trace(q, far, 17, 22)
    out[_TILT_3_5] = tilt(q, 3, 5)
    out[_TILT_6_9] = tilt(q, 6, 9)
    out[_TILT_10_14] = tilt(q, 10, 14)
    out[_TILT_15_19] = tilt(q, 15, 19)
    out[_TILT_20_24] = tilt(q, 20, 24)

    s = profile.AT_28
    v = q[s + _HALF - 1]
    if v < 512:
        v = 512
    s += _AT_8_MM
    out[_INV_CURVATURE] = _ratio((_OUTER * q[s] + (_WEIGHTS - _OUTER) * q[s + 1]) // _WEIGHTS, v)
    out[_LN_WIDTH_FAR] = spread(q, 24, 33, total)
    out[_LN_WIDTH_NEAR] = spread(q, 0, 2, _window(q, profile.TOTAL, 0, 2)) - out[_LN_WIDTH_FAR]
    s = profile.FAR
    v = 0
    for i in range(_OUTERMOST):
        v += q[s + i]
    out[_EDGE_FAR] = _ratio(v * _HALF // _OUTERMOST, total)
    s = profile.NEAR
    v = 1
    for i in range(_HALF):
        if q[s + i] > v:
            v = q[s + i]
    total = 0
    for i in range(_HALF):
        total += q[s + i]
    out[_LN_PEAK] = _ln(v * _HALF) - _ln(total if total > 1 else 1)
    bump(q, far, out)


def bump(q, far, out):
    """How the image changes along the stroke by its shape alone: eleven changes over their rms, and that.

    far: the middle sensors' sum over 24..33 mm.
    """
    out[_PULL] = out[_TILT_3_5]
    out[_PULL + 1] = out[_TILT_6_9]
    out[_PULL + 2] = out[_TILT_10_14]
    out[_PULL + 3] = out[_TILT_15_19]
    out[_PULL + 4] = out[_TILT_20_24]
    out[_PULL + 5] = tilt(q, 25, 33)
    out[_LIFT] = trace(q, far, 0, 2)
    out[_LIFT + 1] = out[_TRACE_3_5]
    out[_LIFT + 2] = out[_TRACE_7_9]
    out[_LIFT + 3] = out[_TRACE_12_16]
    out[_LIFT + 4] = out[_TRACE_17_22]
    most = _LEAST_CHANGE
    for i in range(_PULL, ACROSS):
        v = out[i]
        if i >= _LIFT:
            if v > _MOST_LIFT:
                v = _MOST_LIFT
            elif v < -_MOST_LIFT:
                v = -_MOST_LIFT
            v <<= 2
            out[i] = v
        if v < 0:
            v = -v
        if v > most:
            most = v
    r = _ratio(_LEAST_CHANGE, most)
    s = _mul(r, r)
    for i in range(_PULL, ACROSS):
        r = _ratio(out[i], most)
        out[i] = r
        s += _mul(r, r)
    s = (_ln(s) - _LN_CHANGES) >> 1  # ln of their rms over the greatest, and 12 ln 2
    out[BUMP] = _ln(most) + s - 36 * _LN2  # 24 of `most` in Q24, 12 of s
    s = fixed.exp(12 * _LN2 - s, 0)
    for i in range(_PULL, ACROSS):
        out[i] = _mul(out[i], s)


def dip(q, far, low, high):
    """1 - D / D far over low..high mm; far: the sum over 24..33 mm of both sides."""
    n = high - low + 1
    return -less_one(_window(q, profile.DEPTH, low, high) * 10 // n, far)


def trace(q, far, low, high):
    """Middle pressure / far - 1 over low..high mm."""
    n = high - low + 1
    return less_one(_window(q, profile.CENTRE, low, high) * 10 // n, far)


def tilt(q, low, high):
    """Centre of pressure in mm over low..high mm, positive away from the lump."""
    total = _window(q, profile.TOTAL, low, high)
    r = _ratio(_window(q, profile.TILT, low, high), total if total > 1024 else 1024)
    return r - _mul(r, LESS_THAN_PITCH)


def spread(q, low, high, total):
    """ln of the image's rms half width in mm over low..high mm."""
    s = 0
    for j in range(low, high + 1):
        s += q[profile.SPREAD + j] >> 4
    return ((_ln(s) - _ln((total if total > 1024 else 1024) >> 4) + LN_SPREAD) >> 1) + LN_HALF_PITCH


def no_press(out):
    """Mark the press's features as absent."""
    for i in range(PRESS, BUMP):
        if i != _BASE_SHARE:
            out[i] = ABSENT


def finish(force, count_mpa, out):
    """Add the sensor's unit to the features in kPa and N/m, and hold every feature in its range.

    force: mean sum of an image, Q5 counts.
    """
    unit = _ln(count_mpa)
    out[_LN_BASE] += unit
    out[_LN_AMP] += unit
    out[_LN_FORCE] = _ln(force) + LN_SUM_TO_N_PER_M + unit
    out[_BASE_SHARE] = out[_LN_BASE] - out[_LN_FORCE]
    no_press(out)
    for i in range(ACROSS, ACROSS_END):
        out[i] = ABSENT
    for i in range(COUNT):
        if out[i] > 0x1FFFFFFF:
            out[i] = 0x1FFFFFFF
        elif out[i] < -0x1FFFFFFF:
            out[i] = -0x1FFFFFFF
