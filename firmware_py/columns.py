"""Which columns see the lump: all of them if it runs right across, about six for a ball.

Each column's tactile map is compared with the bump found in their mean. Columns are used from the
best one outwards for as long as they show at least half of it; unless the bump stands out from the
columns' own scatter, and is clearly smaller elsewhere, all are used.

Where a hand presses harder the image grows sideways: the columns at the edge gain more than their part of
the force, those in the middle less. In some columns' rows that would be a bump; `even_out` takes it out.
"""

from firmware_py import constant, fixed, geometry

const = constant.const

_exp = fixed.exp
_ln = fixed.ln
_mul = fixed.mul
_ratio = fixed.ratio

COLS = geometry.COLUMNS
CLEAR = 6  # the best column must rise this many times the scatter above the columns that see nothing
NEARLY_ALL = COLS * 11 // 13
_ROWS = geometry.ROWS
FEWEST = 8  # bins beside the lump
# from so far off the lump the images tell what the force does to the columns' share
_BESIDE_UM = const(16000)
_LEAST = const(2048)  # of a bin's image, Q5 counts: less is no contact
_LEAN = const(16777)  # .001: with squares of ln force that add up to this the slope leans half way to none
_NONE = const(0x3FFFFFFF)
# how many columns from the best one those lie that are up to 2, 5, 9 and 15 mm off
_RINGS = bytes([x // geometry.PITCH_UM for x in (2000, 5000, 9000, 15000)])
_LEAST_CORE = const(128)  # Q3 counts: of weaker bumps columns see little but noise
_MOST_OF_CORE = const(0x4000000)  # 4, Q24


def make_bump(points, centre, stdev, bump):
    """The bump (centre and stdev in Q16 mm) less its mean, in bump[0..points); its norm, 0 if it is flat."""
    wide = stdev >> 4
    s = 0
    for i in range(points):
        z = (((i << 16) - centre) << 8) // wide
        bump[i] = _exp(-(z * z >> 1), 14) if -21000 < z < 21000 else 0
        s += bump[i]
    mean = s // points
    over = s - mean * points
    norm = 0
    for i in range(points):
        # its sum is 0 to the last bit: what all places read alike must not count
        bump[i] -= mean + 1 if i < over else mean
        norm += bump[i] * bump[i]
    if norm < 4096:
        return 0
    return norm >> 10


def respond(maps, points, bump, norm, answer, first, columns):
    """How much of the bump each of `columns` columns from `first` on sees: answer[c] in Q3 counts.

    maps: points x columns, Q7 counts (traces.map_columns); bump, norm: from `make_bump`.
    """
    for c in range(columns):
        s = 0
        j = c
        for i in range(points):
            s += bump[i] * (maps[j] >> 4)
            j += columns
        answer[first + c] = s // norm


def smooth(answer, half, out):
    """Running mean of 2 half + 1 columns, fewer at the edges."""
    for c in range(COLS):
        a = c - half if c > half else 0
        b = c + half + 1 if c + half < COLS else COLS
        s = 0
        for k in range(a, b):
            s += answer[k]
        out[c] = s // (b - a)


def scatter(answer):
    """Median of |second difference|, made to stand for one column's standard error."""
    low = 0
    high = 0x100000
    while high - low > 1:
        mid = (low + high) >> 1
        n = 0
        for c in range(1, COLS - 1):
            v = answer[c - 1] + answer[c + 1] - 2 * answer[c]
            if -mid < v < mid:
                n += 1
        if n >= COLS // 2 - 1:
            high = mid
        else:
            low = mid
    # median |N(0, 6 sigma^2)| = 1.65 sigma
    return high * 39 // 64


def best_of(answer, out):
    """The column where three neighbours' mean, out[c], is greatest."""
    smooth(answer, 1, out)
    best = 0
    for c in range(COLS):
        if out[c] > out[best]:
            best = c
    return best


def rings(answer, out, found, at):
    """Set found[at], ... to what columns ever further from the best see of the bump, over what it sees.

    found[at]: those over 2 and up to 5 mm off, then up to 9 mm, then up to 15 mm; the best is all within 2
    mm, and 16 counts at least. Q24, held at +-4.
    """
    best = best_of(answer, out)
    for i in range(10):
        out[i] = 0
    for c in range(COLS):
        k = 0
        while k < 4 and abs(c - best) > _RINGS[k]:
            k += 1
        out[k] += answer[c]
        out[k + 5] += 1
    near = out[5]
    core = max(out[0], _LEAST_CORE * near)
    for k in range(1, 4):
        v = _ratio(out[k] * near, core * out[k + 5]) if out[k + 5] else 0
        found[at] = max(-_MOST_OF_CORE, min(_MOST_OF_CORE, v))
        at += 1


def choose(answer, out, span):
    """Set span[0], span[1] to the first column used and the one after the last; returns the best column."""
    span[0] = 0
    span[1] = COLS
    best = best_of(answer, out)
    peak = out[best]
    noise = scatter(answer) + 1
    # standard error of three columns' mean: .58 of one's
    if peak * 12 < CLEAR * noise * 7:
        return best
    half = peak >> 1
    a = best
    while a > 0 and out[a - 1] >= half:
        a -= 1
    b = best + 1
    while b < COLS and out[b] >= half:
        b += 1
    if b - a >= NEARLY_ALL:
        return best
    # elsewhere, the mean must be clearly below half of the peak too
    s = 0
    n = 0
    for c in range(COLS):
        if c < a - 2 or c >= b + 2:
            s += answer[c]
            n += 1
    if n >= 4 and s * 3 > peak * n:
        return best
    span[0] = a
    span[1] = b
    return best


def even_out(x_um, n, place_um, rows, part, force, mean):
    """Correct some columns' rows (n images) for the hand's force, which changes their share of it.

    ln(share) is taken as linear in ln(force). The slope is fitted off the lump by least squares, with a prior
    that holds it at 0 where the force hardly changes.

    part[k]: the k-th image's sum over these columns, which is overwritten; force[k]: over all; mean: of all.
    """
    of_mean = _ln(mean)
    used = 0
    middle = 0
    level = 0
    for k in range(n):
        if part[k] > _LEAST and force[k] > _LEAST:
            part[k] = _ln(part[k]) - _ln(force[k])
            if beside(x_um[k] - place_um):
                used += 1
                middle += (_ln(force[k]) - of_mean) >> 6
                level += part[k] >> 6
        else:
            part[k] = _NONE
    if used < FEWEST:
        return
    middle = middle // used << 6
    level = level // used << 6
    square = _LEAN
    product = 0
    for k in range(n):
        if part[k] != _NONE and beside(x_um[k] - place_um):
            u = held(_ln(force[k]) - of_mean - middle)
            square += _mul(u, u)
            product += _mul(u, held(part[k] - level))
    slope = fixed.ratio(product, square)
    for k in range(n):
        if part[k] != _NONE:
            v = held(_mul(slope, held(_ln(force[k]) - of_mean)))
            v = _exp(-v, 0) - 0x1000000
            for i in range(_ROWS * k, _ROWS * k + _ROWS):
                rows[i] += _mul(rows[i], v)


def beside(x_um):
    """Whether a place is well off the lump."""
    return not -_BESIDE_UM < x_um < _BESIDE_UM


def held(v):
    """Within +-.5, Q24."""
    if v > 0x800000:
        return 0x800000
    return v if v > -0x800000 else -0x800000
