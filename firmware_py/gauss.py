"""Gaussian on a base, by damped least squares (Levenberg 1944, Marquardt 1963) in integers.

y(x) = base + amp exp(-(x - centre)^2 / 2 stdev^2) on a 1 mm grid. Map, base and amp in Q11 counts, centre
and stdev in Q16 mm. The base is eliminated; the other three steps are relative: dA/A, dc/S, dS/S.

The residual is scaled to fill 12 bits before it is multiplied, so the gradient is exact to a few parts in
ten thousand of itself however small the noise is: the fit ends where the gradient vanishes, and the coarser
Hessian only determines how fast.
"""

from firmware_py import constant, fixed

const = constant.const

_mul = fixed.mul
_ratio = fixed.ratio
_ln = fixed.ln
_exp = fixed.exp

BASE = const(0)
AMP = const(1)
CENTRE = const(2)
STDEV = const(3)
COST = const(4)  # ln of the sum of squared residuals, Q24
PARAMS = const(5)
WORK = 256  # numbers of working space: four for each of up to 64 points
# the sums s: of products of the three slopes a, b, c (in amplitude, centre, stdev) and the residual e
_AA = const(0)
_AB = const(1)
_AC = const(2)
_BB = const(3)
_BC = const(4)
_CC = const(5)
_AE = const(6)
_BE = const(7)
_CE = const(8)
_SCALE = const(9)  # by how many bits e was scaled up
_MEAN = const(10)  # of the map
_SHIFT = const(11)  # by which the map was scaled up
_LN2 = const(11629080)  # fixed.LN2
MIN_STDEV = 98304  # 1.5 mm
MAX_STDEV = 1638400  # 25 mm
EDGE = 917504  # the centre stays 14 mm inside the grid's ends


def prepare(y, n, work, s):
    """The map less its mean, scaled up to 21 bits, into work[3n..4n); mean and shift into the sums s."""
    total = 0
    for i in range(n):
        total += y[i] >> 3
    mean = total * 8 // n
    top = 1
    for i in range(n):
        v = y[i] - mean
        if v < 0:
            v = -v
        if v > top:
            top = v
    k = 0
    while top < 0x100000 and k < 12:
        top <<= 1
        k += 1
    for i in range(n):
        work[3 * n + i] = (y[i] - mean) << k
    s[_MEAN] = mean
    s[_SHIFT] = k


def residuals(n, p, work):
    """The Gaussian, the place in stdevs and the residual at each point into work; the mean residual."""
    amp = p[AMP]
    wide = p[STDEV] >> 4
    half = wide >> 1
    total = 0
    x = -p[CENTRE]
    for i in range(n):
        z = ((x << 8) + half) // wide
        if -21000 < z < 21000:
            g = _exp(-(z * z >> 1), 0)
        else:
            g = 0
            z = 0
        r = work[3 * n + i] - _mul(amp, g)
        work[i] = (g + 2048) >> 12
        work[n + i] = z
        work[2 * n + i] = r
        total += r >> 3
        x += 65536
    return total * 8 // n


def products(n, base, work, s):
    """Sums of products of the slopes with each other and with the residuals, these less `base` and scaled.

    The Hessian's and the gradient's are without what the base takes away; s[_SCALE]: how far the residuals
    were scaled up. Returns the sum of their squares.
    """
    top = 1
    for i in range(n):
        r = work[2 * n + i] - base
        work[2 * n + i] = r
        if r < 0:
            r = -r
        if r > top:
            top = r
    down = 0
    while top >= 4096:
        top >>= 1
        down += 1
    up = 0
    while top < 2048 and up < 3:
        top <<= 1
        up += 1
    s[_SCALE] = up - down
    sa = sb = sc = se = 0
    aa = ab = ac = ae = bb = bc = be = cc = ce = ee = 0
    for i in range(n):
        a = work[i]
        z = work[n + i]
        e = (work[2 * n + i] << up) >> down
        b = a * z >> 12
        c = b * z >> 12
        sa += a
        sb += b
        sc += c
        se += e
        aa += a * a
        ab += a * b
        ac += a * c
        ae += a * e
        bb += b * b
        bc += b * c
        be += b * e
        cc += c * c
        ce += c * e
        ee += e * e
    # what the base takes away: sum(u v) - sum(u) sum(v) / n, halved twice to stay below 2^28
    qa = sa // n
    ra = sa - qa * n
    qb = sb // n
    rb = sb - qb * n
    qc = sc // n
    rc = sc - qc * n
    s[_AA] = (aa - (sa * qa + sa * ra // n)) >> 2
    s[_AB] = (ab - (sb * qa + sb * ra // n)) >> 2
    s[_AC] = (ac - (sc * qa + sc * ra // n)) >> 2
    s[_BB] = (bb - (sb * qb + sb * rb // n)) >> 2
    s[_BC] = (bc - (sc * qb + sc * rb // n)) >> 2
    s[_CC] = (cc - (sc * qc + sc * rc // n)) >> 2
    s[_AE] = (ae - (se * qa + se * ra // n)) >> 2
    s[_BE] = (be - (se * qb + se * rb // n)) >> 2
    s[_CE] = (ce - (se * qc + se * rc // n)) >> 2
    return ee


def evaluate(n, p, work, s):
    """Residuals of the parameters p against the prepared map; sets p[BASE], p[COST], work and the sums s."""
    p[BASE] = residuals(n, p, work)
    ee = products(n, p[BASE], work, s)
    p[COST] = _ln(ee) - 2 * s[_SCALE] * _LN2


def solve(s, damp, hold, d):
    """The step (dA, dc/S, dS/S in units of the scaled residual, Q24) of the damped 3 x 3 system.

    `hold` fixes stdev (bit 0) or centre (bit 1) at its bound. Returns 0 where the system is singular.
    """
    h00 = s[_AA] + (s[_AA] >> damp) + 4
    h01 = s[_AB]
    h02 = s[_AC]
    h11 = s[_BB] + (s[_BB] >> damp) + 4
    h12 = s[_BC]
    h22 = s[_CC] + (s[_CC] >> damp) + 4
    g0 = s[_AE]
    g1 = s[_BE]
    g2 = s[_CE]
    if hold & 1:
        h02 = h12 = g2 = 0
    if hold & 2:
        h01 = h12 = g1 = 0
    l10 = _ratio(h01, h00)
    l20 = _ratio(h02, h00)
    h11 -= _mul(l10, h01)
    h12 -= _mul(l10, h02)
    h22 -= _mul(l20, h02)
    if h11 <= 0:
        return 0
    l21 = _ratio(h12, h11)
    h22 -= _mul(l21, h12)
    if h22 <= 0:
        return 0
    g1 -= _mul(l10, g0)
    g2 -= _mul(l20, g0) + _mul(l21, g1)
    x2 = _ratio(g2, h22)
    x1 = _ratio(g1, h11) - _mul(l21, x2)
    d[0] = _ratio(g0, h00) - _mul(l10, x1) - _mul(l20, x2)
    d[1] = x1
    d[2] = x2
    return 1


def limit(v, most):
    """v held within +-most."""
    if v > most:
        return most
    if v < -most:
        return -most
    return v
