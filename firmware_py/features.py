"""Features of a stroke, Q24 each, held at +-(2^29 - 1). The ids are the places in NAMES and stay as they are.

The first six are the thesis' (as logarithms or ratios); docs/features.md gives every formula.
"""

from firmware_py import fixed, geometry, profile

_ln = fixed.ln
_ratio = fixed.ratio
_mul = fixed.mul
_window = profile.window

FEATURES_VERSION = 1
NAMES = (
    "ln_base",  # ln(Base / kPa)
    "ln_amp",  # ln(Amp / kPa), Amp at least Base / 512
    "ln_stdev",  # ln(Stdev / mm)
    "inv_curvature",  # pressure 8 mm off the middle over that at the middle, 28 mm from the lump
    "ln_d28",  # ln(D / mm), 26..30 mm from the lump
    "ln_d0",  # ln(D / mm), within 2 mm
    "ln_force",  # ln(F / (N/m)): the image's sum, mean of the stroke, all columns
    "asinh_amp",  # asinh(100 Amp / Base)
    "ln_d_far",  # ln(D / mm), 24..33 mm
    "dip_6_10",  # 1 - D / D far, 6..10 mm
    "ln_centre_share",  # ln(middle pressure / image mean), far
    "ln_misfit",  # ln(rms residual / Base + 1e-4)
    "asinh_rise",  # asinh(32 (middle pressure near / far - 1))
    "trace_7_9",  # middle pressure 7..9 mm / far - 1
    "trace_12_16",  # middle pressure 12..16 mm / far - 1
    "dip_0_2",
    "dip_3_5",
    "dip_12_16",
    "dip_17_22",
    "trace_3_5",
    "trace_17_22",
    "tilt_3_5",  # centre of pressure, mm, positive away from the lump, 3..5 mm
    "tilt_6_9",
    "tilt_10_14",
    "ln_width_far",  # ln(rms half width of the image / mm), far
    "ln_width_near",  # the same near the lump, less ln_width_far
    "edge_far",  # mean of the two outermost sensors / image mean, far
    "ln_peak",  # ln(greatest pressure of the near image / image mean)
    "tilt_15_19",
    "tilt_20_24",
)
COUNT = 30

LN_COUNT_TO_KPA = -359705684  # ln(1 / (2^11 1e6)): Q11 counts of 1 mPa to kPa
_LN_PITCH = fixed.ln(geometry.PITCH_UM)
LN_SUM_TO_N_PER_M = _LN_PITCH - 405824108  # ln(pitch / (2^5 1e9)): sum of Q5 counts of 1 mPa to N/m
LN_DEPTH_TO_MM = -162409222  # ln(1 / 16e3)
LN_HALF_PITCH = _LN_PITCH - 127521983  # ln(pitch / 2000)
LESS_THAN_PITCH = 0x1000000 - ((geometry.PITCH_UM << 16) // 1000 << 7)  # 1 - half a pitch in mm
_LN_SHARE = _ln(geometry.ROWS) - _ln(profile.MIDDLE)
_LN_SPREAD = profile.SPREAD_SHIFT * 11629080
_HALF = geometry.HALF_ROWS
_OUTERMOST = profile.OUTERMOST
_AT_8_MM, _OUTER, _WEIGHTS = geometry.between(8000)
TENTH_PERMILLE = 1678  # 1e-4
FLOOR = 16384  # the least base, Q11: 8 counts


def asinh_of(v, times):
    """asinh(times v) for a Q24 number v, however large the product."""
    a = v if v >= 0 else -v
    if a < 0x10000000 // times:
        return fixed.asinh(v * times)
    r = _ratio(0x1000000 // times, a)
    r = _ln(a) - 23 * 11629080 + _ln(times) + (_mul(r, r) >> 2)
    return r if v >= 0 else -r


def less_one(a, b):
    """a / b - 1 in Q24 for b > 0."""
    return _ratio(a - b, b)


def from_fit(p, n, out):
    """The features that the Gaussian alone decides; pressures still in units of the sensor's count."""
    base = p[0] if p[0] > FLOOR else FLOOR
    amp = p[1]
    out[0] = _ln(base) + LN_COUNT_TO_KPA
    least = base >> 9
    out[1] = _ln(amp if amp > least else least) + LN_COUNT_TO_KPA
    out[2] = _ln(p[3]) - 16 * 11629080
    out[7] = asinh_of(_ratio(amp, base), 100)
    out[11] = _ln(fixed.exp(((p[4] - _ln(n)) >> 1) - _ln(base), 0) + TENTH_PERMILLE) - 24 * 11629080


def from_profile(q, out):
    """The features of the folded profile (profile.measure)."""
    far = _window(q, profile.DEPTH, 24, 33)
    far = far if far > 320 else 320
    out[4] = _ln(_window(q, profile.DEPTH, 26, 30) // 10) + LN_DEPTH_TO_MM
    out[5] = _ln(_window(q, profile.DEPTH, 0, 2) // 6) + LN_DEPTH_TO_MM
    out[8] = _ln(far // 20) + LN_DEPTH_TO_MM
    out[15] = dip(q, far, 0, 2)
    out[16] = dip(q, far, 3, 5)
    out[9] = dip(q, far, 6, 10)
    out[17] = dip(q, far, 12, 16)
    out[18] = dip(q, far, 17, 22)

    far = _window(q, profile.CENTRE, 24, 33)
    far = far if far > 2560 else 2560
    total = _window(q, profile.TOTAL, 24, 33)
    total = total if total > 10240 else 10240
    out[10] = _ln(far) - _ln(total) + _LN_SHARE
    out[12] = asinh_of(trace(q, far, 0, 2), 32)
    out[19] = trace(q, far, 3, 5)
    out[13] = trace(q, far, 7, 9)
    out[14] = trace(q, far, 12, 16)
    out[20] = trace(q, far, 17, 22)
    out[21] = tilt(q, 3, 5)
    out[22] = tilt(q, 6, 9)
    out[23] = tilt(q, 10, 14)
    out[28] = tilt(q, 15, 19)
    out[29] = tilt(q, 20, 24)

    s = profile.AT_28
    v = q[s + _HALF - 1]
    if v < 512:
        v = 512
    s += _AT_8_MM
    out[3] = _ratio((_OUTER * q[s] + (_WEIGHTS - _OUTER) * q[s + 1]) // _WEIGHTS, v)
    out[24] = spread(q, 24, 33, total)
    out[25] = spread(q, 0, 2, _window(q, profile.TOTAL, 0, 2)) - out[24]
    s = profile.FAR
    v = 0
    for i in range(_OUTERMOST):
        v += q[s + i]
    out[26] = _ratio(v * _HALF // _OUTERMOST, total)
    s = profile.NEAR
    v = 1
    for i in range(_HALF):
        if q[s + i] > v:
            v = q[s + i]
    total = 0
    for i in range(_HALF):
        total += q[s + i]
    out[27] = _ln(v * _HALF) - _ln(total if total > 1 else 1)


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
    return ((_ln(s) - _ln((total if total > 1024 else 1024) >> 4) + _LN_SPREAD) >> 1) + LN_HALF_PITCH


def finish(force, count_mpa, out):
    """Add the sensor's unit to the features in kPa and N/m, and hold every feature in its range.

    force: mean sum of an image, Q5 counts.
    """
    unit = _ln(count_mpa)
    out[0] += unit
    out[1] += unit
    out[6] = _ln(force) + LN_SUM_TO_N_PER_M + unit
    for i in range(30):
        if out[i] > 0x1FFFFFFF:
            out[i] = 0x1FFFFFFF
        elif out[i] < -0x1FFFFFFF:
            out[i] = -0x1FFFFFFF
