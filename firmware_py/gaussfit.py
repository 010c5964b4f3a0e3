"""The fit of firmware_py.gauss: where it starts, how it descends, and what it tries for a weak bump."""

from firmware_py import constant, fixed, gauss

const = constant.const

_mul = fixed.mul
_ratio = fixed.ratio
_ln = fixed.ln
_limit = gauss.limit
_evaluate = gauss.evaluate
_solve = gauss.solve
_prepare = gauss.prepare

# numbers of gauss.py, where they are explained; a test holds them equal
_BASE = const(0)
_AMP = const(1)
_CENTRE = const(2)
_STDEV = const(3)
_COST = const(4)
_PARAMS = const(5)
_BE = const(7)
_CE = const(8)
_SCALE = const(9)
_MEAN = const(10)
_SHIFT = const(11)
_LN2 = const(11629080)
MIN_STDEV = gauss.MIN_STDEV
MAX_STDEV = gauss.MAX_STDEV
EDGE = gauss.EDGE
MAX_AMP = 0x4000000
TURNS = 60
SLACK = 8192
WEAK = 60121846  # ln 36: amp six times the rms residual


def start(y, n, p, width_um):
    """Amplitude and stdev to start from, for a bump of width_um at p[CENTRE]; base from the map's mean."""
    total = 0
    for i in range(n):
        total += y[i] >> 3
    k = p[_CENTRE] >> 16
    top = (y[k - 1] + y[k] + y[k + 1]) // 3
    p[_STDEV] = (width_um << 8) // 1000 << 8
    amp = top - total * 8 // n
    p[_AMP] = amp if amp > 64 else 64


def flat(y, n, p):
    """What stands in p where there is no bump: the mean as base, amplitude 0, the widest stdev."""
    total = 0
    for i in range(n):
        total += y[i] >> 3
    base = total * 8 // n
    cost = 1
    for i in range(n):
        v = (y[i] - base) >> 6
        v = v if v >= 0 else -v
        v = v if v < 4096 else 4095
        cost += v * v
    p[_BASE] = base
    p[_AMP] = 0
    p[_CENTRE] = (n >> 1) << 16
    p[_STDEV] = MAX_STDEV
    p[_COST] = _ln(cost) + 12 * 11629080


def relative(x, amp, scale):
    """x (scaled residual, Q24) over amp: the relative step in Q24."""
    while scale > 0 and amp < 0x20000:
        amp <<= 1
        scale -= 1
    while scale < 0 and amp > 1:
        amp >>= 1
        scale += 1
    while scale > 0:
        x >>= 1
        scale -= 1
    while amp >= 0x20000:
        amp >>= 1
        x >>= 1
    return _ratio(x, amp << 12)


def descend(n, p, best, work, s, d):
    """Levenberg's and Marquardt's steps on the prepared map; returns how many."""
    high = (n - 1) * 65536 - EDGE
    _evaluate(n, p, work, s)
    for i in range(_PARAMS):
        best[i] = p[i]
    damp = 7
    turn = 0
    while turn < TURNS:
        turn += 1
        hold = 0
        if (p[_STDEV] <= MIN_STDEV and s[_CE] < 0) or (p[_STDEV] >= MAX_STDEV and s[_CE] > 0):
            hold = 1
        if (p[_CENTRE] <= EDGE and s[_BE] < 0) or (p[_CENTRE] >= high and s[_BE] > 0):
            hold |= 2
        if not _solve(s, damp, hold, d):
            damp = damp - 2 if damp > 2 else 1
            if damp == 1:
                break
            continue
        for i in range(3):
            d[i] = _limit(relative(d[i], p[_AMP], s[_SCALE]), 8388608)
        p[_AMP] += _mul(p[_AMP], d[0])
        p[_AMP] = _limit(p[_AMP], MAX_AMP)
        if p[_AMP] < 1:
            p[_AMP] = 1
        p[_CENTRE] += _mul(p[_STDEV], d[1])
        if p[_CENTRE] < EDGE:
            p[_CENTRE] = EDGE
        elif p[_CENTRE] > high:
            p[_CENTRE] = high
        p[_STDEV] += _mul(p[_STDEV], _limit(d[2], 5033164))
        if p[_STDEV] < MIN_STDEV:
            p[_STDEV] = MIN_STDEV
        elif p[_STDEV] > MAX_STDEV:
            p[_STDEV] = MAX_STDEV
        small = -1000 < d[0] < 1000 and -1000 < d[1] < 1000 and -1000 < d[2] < 1000
        _evaluate(n, p, work, s)
        # the sum of squares is known to a few parts in ten thousand, the gradient far better
        if p[_COST] <= best[_COST] + SLACK:
            for i in range(_PARAMS):
                best[i] = p[i]
            if damp < 20:
                damp += 4
            if small:
                break
        else:
            if small:
                break
            for i in range(_PARAMS):
                p[i] = best[i]
            _evaluate(n, p, work, s)
            damp -= 3
            if damp < 1:
                break
    for i in range(_PARAMS):
        p[i] = best[i]
    return turn


def fit(y, n, p, best, work, s, d):
    """Least squares from the start in p (amp, centre, stdev); leaves the best parameters in p.

    best, d: space for PARAMS numbers. Returns the iterations, or 0 if p holds no bump to start from.
    """
    if p[_AMP] < 1:
        return 0
    _prepare(y, n, work, s)
    p[_AMP] = _limit(p[_AMP], 0xFFFFFF >> s[_SHIFT]) << s[_SHIFT]
    turn = descend(n, p, best, work, s, d)
    half = (1 << s[_SHIFT]) >> 1
    p[_BASE] = s[_MEAN] + ((p[_BASE] + half) >> s[_SHIFT])
    p[_AMP] = (p[_AMP] + half) >> s[_SHIFT]
    p[_COST] -= 2 * s[_SHIFT] * _LN2
    return turn


def fit_from(y, n, p, best, work, s, d, place, width_um, keep):
    """The fit from a bump of width_um at the grid's point `place`; tried from other widths too if it is weak.

    keep: space for PARAMS numbers. Returns the iterations of all fits together, 0 if there is no bump.
    """
    p[_CENTRE] = place << 16
    start(y, n, p, width_um)
    turns = fit(y, n, p, best, work, s, d)
    # where the bump is over six times the rms residual the cost has one minimum
    if turns == 0 or 2 * _ln(p[_AMP]) - p[_COST] + _ln(n) > WEAK:
        return turns
    for width in (3000, 13000):
        for i in range(_PARAMS):
            keep[i] = p[i]
        p[_CENTRE] = place << 16
        start(y, n, p, width)
        turns += fit(y, n, p, best, work, s, d)
        if p[_COST] >= keep[_COST]:
            for i in range(_PARAMS):
                p[i] = keep[i]
    return turns
