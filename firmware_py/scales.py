"""Between the link scale, where a model predicts (Q24), and the outputs' units; integers only.

`clip`, `pick` and `exp` hold the only branches on data of an evaluation: the exporter's proof exchanges them
(model_export/integers/bounds.py).
"""

MAX_LN_WIDTH = 34887240  # ln 8
MIN_LN_WIDTH = -268435456  # -16: a width below 2e-7

# 2^(i / 64) in Q24, 4.3e-7 larger: what `exp` rounds down on the way, on average
POWERS = (
    16777223, 16959915, 17144596, 17331289, 17520014, 17710795, 17903653, 18098611, 18295692, 18494919,
    18696315, 18899905, 19105711, 19313759, 19524072, 19736675, 19951593, 20168852, 20388476, 20610492,
    20834926, 21061803, 21291151, 21522997, 21757367, 21994289, 22233791, 22475901, 22720647, 22968059,
    23218165, 23470994, 23726577, 23984942, 24246121, 24510144, 24777042, 25046846, 25319588, 25595301,
    25874015, 26155765, 26440582, 26728501, 27019556, 27313779, 27611207, 27911873, 28215814, 28523064,
    28833659, 29147637, 29465034, 29785888, 30110235, 30438114, 30769563, 31104621, 31443329, 31785724,
    32131848, 32481741, 32835444, 33192998,
)  # fmt: skip


def clip(v, lo, hi):
    """v held between lo and hi."""
    if v < lo:
        return lo
    if v > hi:
        return hi
    return v


def pick(v, limit, below, above):
    """`below` where v < limit, else `above`."""
    if v < limit:
        return below
    return above


def exp(v, s):
    """exp(v / 2^24) in Q(24 - s), within 1e-6 and a unit; held at 2^30 - 1. Quicker than fixed.exp."""
    k = v // 181704  # v in 64ths of ln 2, which are 3 / 8 longer
    v -= k * 181704 + (k * 3 >> 3)
    m = POWERS[k & 63]
    w = v >> 3
    v += w * w >> 19
    m += (m >> 10) * (v >> 3) >> 11
    s -= k >> 6
    if s > 0:
        return m + (1 << s - 1) >> s if s < 31 else 0
    return m << -s if s > -5 else 0x3FFFFFFF


def scaled(v, s):
    """v / 2^s, s of either sign; held at +-2^29, far outside what any output is clipped to."""
    if s >= 0:
        return clip(v >> s, -536870912, 536870912)
    most = 1 << (29 + s)
    return clip(v, -most, most) << -s


def width(ln_width):
    """Half an interval on the link scale, Q24, at most 8."""
    return exp(clip(ln_width, MIN_LN_WIDTH, MAX_LN_WIDTH), 0)


def value(y, link):
    """Millionths of the output's unit from y on the link scale.

    link: 1: y is ln of millionths; 0: y is in the unit; else y is in 2^(26 - link) millionths.
    """
    if link == 1:
        return exp(y, 24)
    if link:
        return y + (1 << link >> 3) >> link - 2
    return ((y >> 12) * 15625 + ((y & 4095) * 15625 >> 12) + 32) >> 6
