"""The loops that work a stroke out once more in viper: its maps, the force map, the fit, the profile.

    from firmware_py import stroke_viper
    stroke_viper.install()

See hot_viper.py, its fellow for the frames, also for why no number here needs more than 16 bits. Those that
do are in the table that `residuals` and `bump_table` hand on: the 23 of fixed.exp, and ln 2. One file, long
as it is: another module would take of the board's heap what a stroke needs.
"""

# ruff: noqa: F821 - ptr32 is viper's own
from array import array

import micropython

from firmware_py import columns, constant, fixed, forcemap, gauss, geometry, profile, search, traces

const = constant.const

_ROWS = geometry.ROWS
_HALF = geometry.HALF_ROWS
_PITCH_UM = geometry.PITCH_UM
_FIRST_ROW_UM = geometry.FIRST_ROW_UM
_IMAGE = forcemap._IMAGE
_ODD = forcemap._ODD
_OUT = forcemap._OUT
_EVEN_IN = forcemap.EVEN_IN
_EVEN_OUT = forcemap.EVEN_OUT
_FIRST_ODD = forcemap._FIRST_ODD
_RELATIVE_Q = forcemap._RELATIVE_Q
_CENTRE = gauss.CENTRE
_STDEV = gauss.STDEV
_AA = gauss._AA
_AB = gauss._AB
_AC = gauss._AC
_BB = gauss._BB
_BC = gauss._BC
_CC = gauss._CC
_AE = gauss._AE
_BE = gauss._BE
_CE = gauss._CE
_SCALE = gauss._SCALE
_DEPTH = profile.DEPTH
_TOTAL = profile.TOTAL
_TILT = profile.TILT
_SPREAD = profile.SPREAD
_MIDDLE = profile.MIDDLE
_SPREAD_SHIFT = profile.SPREAD_SHIFT
_FAR = profile.FAR
_NEAR = profile.NEAR
_AT_28 = profile.AT_28

_TABLE = array("i", fixed._EXP + (fixed.LN2,))
_LN2_AT = const(23)
_BEYOND = const(32767)  # no number of stdevs


@micropython.viper
def map_rows(x_um: ptr32, n: int, rows: ptr32, start_um: int, out: ptr32, points: int, w: ptr32):
    """See traces.map_rows."""
    stride = int(_ROWS)
    i = 0
    while i < points:
        out[i] = 0
        i += 1
    s = int(_FIRST_ROW_UM)
    row = 0
    while row < stride:
        k = 0
        x = start_um - s
        i = 0
        while i < points:
            while k < n - 2 and x_um[k + 1] <= x:
                k += 1
            # traces.weigh
            left = 0
            right = 0
            t = x - x_um[k]
            h = x_um[k + 1] - x_um[k]
            if t <= 0:
                up = 0
            elif t >= h:
                up = 4096
            else:
                t = (t << 12) // h
                t2 = (t * t + 2048) >> 12
                t3 = (t2 * t + 2048) >> 12
                up = 3 * t2 - 2 * t3
                a = t - 2 * t2 + t3
                b = t3 - t2
                if k > 0:
                    left = 0 - a * h // (x_um[k + 1] - x_um[k - 1])
                    up -= left
                else:
                    up += a
                if k + 2 < n:
                    right = b * h // (x_um[k + 2] - x_um[k])
                else:
                    up += b
            w[0] = left
            w[1] = 4096 - up - left - right
            w[2] = up
            w[3] = right
            j = k * stride + row
            v = w[1] * rows[j] + up * rows[j + stride]
            if left != 0:
                v += left * rows[j - stride]
            if right != 0:
                v += right * rows[j + 2 * stride]
            out[i] = out[i] + (v >> 10)
            x += 1000
            i += 1
        s += int(_PITCH_UM)
        row += 1
    if stride != 16:
        i = 0
        while i < points:
            out[i] = out[i] * 16 // stride
            i += 1


@micropython.viper
def slopes(f: ptr32, w: ptr32, lf: int, ld: int, total: int):
    """See forcemap.slopes."""
    top = 16383
    half_rows = int(_HALF)
    image = int(_IMAGE)
    last = image + int(_ROWS) - 1
    odd = int(_ODD)
    up = int(_RELATIVE_Q) - 1
    mean = (total + half_rows) // int(_ROWS)
    half = mean >> 1
    w[0] = 4096
    w[1] = top if lf > top else (0 - top if lf < 0 - top else lf)
    w[2] = top if ld > top else (0 - top if ld < 0 - top else ld)
    v = (w[1] * w[1] + 2048) >> 12
    w[3] = top if v > top else v
    v = (w[1] * w[2] + 2048) >> 12
    w[4] = top if v > top else (0 - top if v < 0 - top else v)
    v = (w[2] * w[2] + 2048) >> 12
    w[5] = top if v > top else v
    most = 15625  # times 16: a number of 18 bits would lie between the instructions
    most <<= 4
    i = 0
    while i < half_rows:
        a = w[image + i]
        b = w[last - i]
        v = a + b - 2 * mean
        v = most if v > most else (0 - most if v < 0 - most else v)
        v = ((v << up) + half) // mean
        w[6 + i] = top if v > top else (0 - top if v < 0 - top else v)
        v = a - b
        v = most if v > most else (0 - most if v < 0 - most else v)
        v = ((v << up) + half) // mean
        w[odd + i] = top if v > top else (0 - top if v < 0 - top else v)
        i += 1
    down = f[0] - 12
    shift = int(_RELATIVE_Q) - 6
    steep = 1 << 21
    steep -= 1
    outputs = int(_EVEN_OUT)
    inputs = int(_EVEN_IN)
    to = int(_OUT)
    j = 0
    while j < outputs:
        v = 0
        k = 3 + j
        i = 0
        while i < 6:
            v += w[i] * f[k] >> 6
            k += outputs
            i += 1
        while i < inputs:
            v += w[i] * f[k] >> shift
            k += outputs
            i += 1
        v >>= down
        w[to + j] = steep if v > steep else (0 - steep if v < 0 - steep else v)
        j += 1
    j = 0
    while j < half_rows:
        v = 0
        k = int(_FIRST_ODD) + j
        i = 0
        while i < half_rows:
            v += w[odd + i] * f[k] >> shift
            k += half_rows
            i += 1
        w[j] = v >> down
        j += 1
    last = int(_ROWS) - 1
    j = 0
    while j < half_rows:
        a = w[to + j]
        b = w[j]
        v = a + b
        w[j] = steep if v > steep else (0 - steep if v < 0 - steep else v)
        v = a - b
        w[last - j] = steep if v > steep else (0 - steep if v < 0 - steep else v)
        j += 1
    w[last + 1] = w[to + half_rows]


@micropython.viper
def carry(rows: ptr32, at: int, step: int, w: ptr32, out: ptr32, to: int) -> int:
    """See forcemap.carry."""
    half = int(_HALF)
    n = int(_ROWS)
    top = 131072
    high = step >> 12
    low = step & 4095
    total = 0
    i = 0
    while i < n:
        b = w[i] << 6
        d = b >> 12
        b &= 4095
        v = high * d + ((high * b + low * d + (low * b >> 12)) >> 12)
        v = rows[at + i] + (v + half) // n
        if v >= top:
            v = top - 1
        elif v <= 0 - top:
            v = 1 - top
        out[to + i] = v
        total += v
        i += 1
    return total


@micropython.viper
def correlate(work: ptr32, n: int, c: int, reach: int, sums: ptr32):
    """See search.correlate."""
    i = c - reach + 1
    if i < 0:
        i = 0
    e = c + reach
    if e > n:
        e = n
    num = 0
    k1 = 0
    k2 = 0
    while i < e:
        k = work[n + (i - c if i >= c else c - i)]
        num += k * work[i]
        k1 += k
        k2 += k * k
        i += 1
    sums[0] = num
    sums[1] = k1
    sums[2] = k2 - k1 * k1 // n


@micropython.viper
def respond(maps: ptr32, points: int, bump: ptr32, norm: int, answer: ptr32, first: int, columns: int):
    """See columns.respond."""
    c = 0
    while c < columns:
        s = 0
        j = c
        i = 0
        while i < points:
            s += bump[i] * (maps[j] >> 4)
            j += columns
            i += 1
        answer[first + c] = s // norm
        c += 1


@micropython.viper
def _exps(z: ptr32, at: int, n: int, s: int, table: ptr32):
    """exp(-z^2 / 2) of n numbers of Q12 in their place, in Q(24 - s), as fixed.exp; of _BEYOND it is 0."""
    n += at
    while at < n:
        x = z[at]
        if x == _BEYOND:
            z[at] = 0
        else:
            v = 0 - (x * x >> 1)
            k = v // table[_LN2_AT]
            v -= k * table[_LN2_AT]
            i = v >> 19
            v -= (i << 19) + (1 << 18)
            x = v >> 4
            q = (x * x) >> 16
            v += (q >> 1) + (((q >> 4) * x // 6) >> 16)
            x = table[i]
            i = v >> 12
            v &= 4095
            v = (x >> 12) * i + (((x >> 12) * v + (x & 4095) * i + ((x & 4095) * v >> 12)) >> 12)
            x += v
            k = s - k
            if k > 0:
                x = (x + (1 << (k - 1))) >> k
            z[at] = x
        at += 1


@micropython.viper
def _stdevs(n: int, p: ptr32, work: ptr32):
    """How many stdevs each point lies from the centre, twice: for _exps, and for the derivatives."""
    wide = p[int(_STDEV)] >> 4
    half = wide >> 1
    x = 0 - p[int(_CENTRE)]
    i = 0
    while i < n:
        z = ((x << 8) + half) // wide
        work[i] = z
        if z <= -21000 or z >= 21000:
            work[i] = _BEYOND
            z = 0
        work[n + i] = z
        x += 1 << 16
        i += 1


@micropython.viper
def _differences(n: int, amp: int, work: ptr32) -> int:
    """The residuals of a Gaussian of that amplitude; their mean."""
    high = amp >> 12
    low = amp & 4095
    total = 0
    i = 0
    while i < n:
        g = work[i]
        a = g >> 12
        b = g & 4095
        v = work[3 * n + i] - (high * a + ((high * b + low * a + (low * b >> 12)) >> 12))
        work[i] = (g + 2048) >> 12
        work[2 * n + i] = v
        total += v >> 3
        i += 1
    return total * 8 // n


def residuals(n, p, work):
    """gauss.residuals."""
    _stdevs(n, p, work)
    _exps(work, 0, n, 0, _TABLE)  # type: ignore[arg-type]
    return _differences(n, p[gauss.AMP], work)


def bump_table(width_um, n, work):
    """search.bump_table."""
    reach = n
    for d in range(n):
        z = d * 4096000 // width_um
        if z > 14500:
            reach = d
            break
        work[n + d] = z
    _exps(work, n, reach, 16, _TABLE)  # type: ignore[arg-type]
    return reach


@micropython.viper
def products(n: int, base: int, work: ptr32, s: ptr32) -> int:
    """See gauss.products."""
    top = 1
    i = 2 * n
    while i < 3 * n:
        r = work[i] - base
        work[i] = r
        if r < 0:
            r = 0 - r
        if r > top:
            top = r
        i += 1
    down = 0
    while top >= 4096:
        top >>= 1
        down += 1
    up = 0
    while top < 2048 and up < 3:
        top <<= 1
        up += 1
    s[int(_SCALE)] = up - down
    sa = 0
    sb = 0
    sc = 0
    se = 0
    aa = 0
    ab = 0
    ac = 0
    ae = 0
    bb = 0
    bc = 0
    be = 0
    cc = 0
    ce = 0
    ee = 0
    i = 0
    while i < n:
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
        i += 1
    q = sa // n
    r = sa - q * n
    s[int(_AA)] = (aa - (sa * q + sa * r // n)) >> 2
    s[int(_AB)] = (ab - (sb * q + sb * r // n)) >> 2
    s[int(_AC)] = (ac - (sc * q + sc * r // n)) >> 2
    s[int(_AE)] = (ae - (se * q + se * r // n)) >> 2
    q = sb // n
    r = sb - q * n
    s[int(_BB)] = (bb - (sb * q + sb * r // n)) >> 2
    s[int(_BC)] = (bc - (sc * q + sc * r // n)) >> 2
    s[int(_BE)] = (be - (se * q + se * r // n)) >> 2
    q = sc // n
    r = sc - q * n
    s[int(_CC)] = (cc - (sc * q + sc * r // n)) >> 2
    s[int(_CE)] = (ce - (se * q + se * r // n)) >> 2
    return ee


@micropython.viper
def add_place(rows: ptr32, depth: ptr32, k: int, n: int, j: int, out: ptr32, w: ptr32):
    """See profile.add_place."""
    stride = int(_ROWS)
    half = int(_HALF)
    m = j if j >= 0 else 0 - j
    both = 2 if j == 0 else 1
    left = w[0]
    right = w[3]
    v = w[1] * depth[k] + w[2] * depth[k + 1]
    if left != 0:
        v += left * depth[k - 1]
    if right != 0:
        v += right * depth[k + 2]
    out[int(_DEPTH) + m] = out[int(_DEPTH) + m] + both * (v >> 12)
    a = k * stride
    i = 4
    while i < 4 + stride:
        v = w[1] * rows[a] + w[2] * rows[a + stride]
        if left != 0:
            v += left * rows[a - stride]
        if right != 0:
            v += right * rows[a + 2 * stride]
        w[i] = v >> 12
        a += 1
        i += 1
    centre = 0
    total = 0
    tilt = 0
    spread = 0
    a = stride - 1
    i = 0
    while i < half:
        v = w[4 + i]
        u = w[3 + stride - i]
        tilt += (u - v) * a
        v += u
        total += v
        if a < int(_MIDDLE):
            centre += v
        spread += v * a * a >> int(_SPREAD_SHIFT)
        a -= 2
        if m >= 24 and m <= 33:
            out[int(_FAR) + i] = out[int(_FAR) + i] + v
        if m <= 2:
            out[int(_NEAR) + i] = out[int(_NEAR) + i] + both * v
        if m >= 26 and m <= 30:
            out[int(_AT_28) + i] = out[int(_AT_28) + i] + v
        i += 1
    out[m] = out[m] + both * centre
    out[int(_TOTAL) + m] = out[int(_TOTAL) + m] + both * total
    if j != 0:
        out[int(_TILT) + m] = out[int(_TILT) + m] + (tilt if j > 0 else 0 - tilt)
    out[int(_SPREAD) + m] = out[int(_SPREAD) + m] + both * spread


def install():
    """Put them in the place of the plain loops."""
    traces.map_rows = map_rows
    forcemap.slopes = slopes
    forcemap.carry = carry
    search.correlate = correlate
    search.bump_table = bump_table
    columns.respond = respond
    gauss.residuals = residuals
    gauss.products = products
    profile.add_place = add_place
