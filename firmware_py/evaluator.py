"""The model's arithmetic: features in, the five outputs with their intervals out, integers only.

`Tables` holds a model as arrays; `evaluate` works on arrays the caller owns and allocates nothing.
`compute` has no branch on data other than `clip` and `pick`, so the exporter runs this very code on
intervals to prove that no intermediate leaves +-2^30 (model_export/bounds.py).

Numbers: features Q24; u, a feature moved and scaled into +-1 over the model's clip box, and its
monomials Q28; predictions y, ln sigma and widths on the link scale Q24; outputs in millionths.
A Q28 number meets its coefficients as a high part (Q13) and a low part of `low` bits, a coefficient
as a high word of 16 and a low one of 8 or 16 bits; the product of the two low parts is below what is kept.
"""

from array import array

from firmware_py import fixed

OUTPUTS = 5
NO_LUMP = -8  # status.NO_LUMP, repeated: the core of a small board does not carry that table
OUT_SIZE = 18  # value, low, high of each output; then FLAGS, DISTANCE, LEVEL
FLAGS = 15
DISTANCE = 16
LEVEL = 17

LUMP = 1
IN_DOMAIN = 2
SOFT = 4
HARD = 8
FORCE_OUT = 16

# The tables are indexed by plain numbers below, which cost no dictionary look-up; these are their names.
# head: what `compute` and `verdict` need of the model, one integer each
N_FEATURES = 0
N_TERMS = 1  # without the constant; the features themselves come first
N_SIGMA = 2  # leading terms that ln sigma uses
LOW_BITS = 3  # at most 12; low words are bytes up to 8
N_LIMITS = 4
HARD_BELOW = 5  # millionths of E_inv23
FORCE_LO = 6  # millionths of N/m
FORCE_HI = 7
LEVEL_PERMILLE = 8
LINKS = 9  # bit j: output j has a ln link
MARGIN = 10  # how far beyond its range an estimate may lie, in 1/256 of half its interval
HEAD = 11

# feature table: one row of seven for each feature
CLIP_LO = 0
CLIP_HI = 1
CENTRE = 2
SHIFT = 3
FACTOR = 4
BOX_LO = 5
BOX_HI = 6
FEATURE_ROW = 7

# output table: one row of nine for each output
LINK = 0  # 1: ln of millionths, 0: the value itself
Y_LO = 1
Y_HI = 2
Y_MID = 3  # and the shift that takes y - Y_MID into +-1 in Q28
Y_SHIFT = 4
LN_Q_SOFT = 5  # ln of the conformal quantile for each predicted class
LN_Q_HARD = 6
RANGE_LO = 7  # what the model is for, on the link scale; where there is no such end, Y_LO or Y_HI
RANGE_HI = 8
E_OUTPUT = 4  # which output the hardness rule looks at
OUTPUT_ROW = 9

# row table: intercept (Q24) and shift of each sum: outputs, ln sigmas, whitened coordinates
ROW = 2

_MAX_LN_WIDTH = 34887240  # ln 8
_MIN_LN_WIDTH = -268435456  # -16: a width below 2e-7
NO_WIDTH = -536870912  # stands for ln 0

exp = fixed.exp


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


def mul28(a, b):
    """a * b / 2^28 for |a| <= 2^28, |b| <= 2^29."""
    c = a >> 14
    a &= 16383
    d = b >> 14
    b &= 16383
    return c * d + ((c * b + a * d + (a * b >> 14)) >> 14)


def dot(c, d, at, high, low, first, n, bits):
    """Sum of n coefficients (c, d from `at`) times inputs (high, low from `first`)."""
    a = 0
    b = 0
    n += first
    while first < n:
        x = c[at]
        h = high[first]
        a += x * h
        b += x * low[first] + d[at] * h
        at += 1
        first += 1
    return a + (b >> bits)


def dot_high(c, at, high, first, n):
    """One sum with high parts alone, good to 1e-3 of the largest coefficient."""
    a = 0
    for _ in range(n):
        a += c[at] * high[first]
        at += 1
        first += 1
    return a


def scaled(v, s):
    """v / 2^s, s of either sign; held at +-2^29, far outside what any output is clipped to."""
    if s >= 0:
        return clip(v >> s, -536870912, 536870912)
    most = 1 << (29 + s)
    return clip(v, -most, most) << -s


def width(ln_width):
    """Half an interval on the link scale, Q24, at most 8."""
    return exp(clip(ln_width, _MIN_LN_WIDTH, _MAX_LN_WIDTH), 0)


def value(y, link):
    """Millionths of the output's unit from y on the link scale."""
    if link:
        return exp(y, 24)
    return ((y >> 12) * 15625 + ((y & 4095) * 15625 >> 12) + 32) >> 6


def put(v, k, bits, high, low):
    """Keep a Q28 number as input k: its high and its low part."""
    high[k] = v >> 15
    low[k] = (v >> (15 - bits)) & ((1 << bits) - 1)


def standardise(x, ids, feats, n, bits, u, high, low):
    """The features as u, within +-1 over the clip box."""
    at = 0
    for i in range(n):
        v = clip(x[ids[i]], feats[at], feats[at + 1]) - feats[at + 2]
        v = mul28(scaled(v, feats[at + 3]), feats[at + 4])
        u[i] = v
        put(v, 5 + i, bits, high, low)
        at += 7


def multiply(steps, n, terms, bits, u, high, low):
    """The other terms: each a term before it times a feature."""
    at = 0
    k = 5 + n
    mask = (1 << bits) - 1
    down = 15 - bits
    for i in range(n, terms):
        # mul28 and put, written out: a call costs as much as the product
        v = u[steps[at]]
        w = u[steps[at + 1]]
        a = v >> 14
        b = w >> 14
        v &= 16383
        w &= 16383
        v = a * b + ((a * w + v * b + (v * w >> 14)) >> 14)
        u[i] = v
        high[k] = v >> 15
        low[k] = (v >> down) & mask
        at += 2
        k += 1


def predict(c, d, rows, outs, terms, bits, high, low, work, out):
    """The outputs; their predictions, clipped, become inputs 0 to 4."""
    at = 0
    for j in range(5):
        v = dot(c, d, terms * j, high, low, 5, terms, bits)
        v = scaled(v, rows[2 * j + 1]) + rows[2 * j]
        v = clip(v, outs[at + 1], outs[at + 2])
        work[j] = v
        out[3 * j] = value(v, outs[at])
        put(scaled(v - outs[at + 3], outs[at + 4]), j, bits, high, low)
        at += 9


def doubt(c, d, first, rows, outs, n, bits, hard_below, margin, high, low, work, out):
    """The intervals: a quantile for the predicted class times sigma, on the link scale.

    In `work` the predictions give way to how far each lies beyond its range and the margin.
    """
    at = 0
    e = out[12]
    for j in range(5):
        v = dot(c, d, first + n * j, high, low, 0, n, bits)
        v = scaled(v, rows[2 * j + 11]) + rows[2 * j + 10]
        v = clip(v, _MIN_LN_WIDTH, _MAX_LN_WIDTH)
        v = width(v + pick(e, hard_below, outs[at + 6], outs[at + 5]))
        y = work[j]
        out[3 * j + 1] = value(clip(y - v, outs[at + 1], outs[at + 2]), outs[at])
        out[3 * j + 2] = value(clip(y + v, outs[at + 1], outs[at + 2]), outs[at])
        below = outs[at + 7] - y
        above = y - outs[at + 8]
        work[j] = pick(above - below, 0, below, above) - (v >> 8) * margin
        at += 9


def distance(c, at, rows, n, high):
    """Squared distance from the domain's centre, as permille of its edge's."""
    total = 0
    row = 20
    for i in range(n):
        v = scaled(dot_high(c, at, high, 5, i + 1), rows[row + 1]) + rows[row]
        v = clip(v, -16384, 16384)
        total += v * v >> 3
        at += i + 1
        row += 2
    return (total >> 11) * 1000 >> 10


def compute(x, ids, feats, steps, c, d, rows, outs, head, u, high, low, work, out):
    """All outputs and intervals into `out`, and the distance from the domain's centre.

    high and low hold the predictions first, then the terms; work holds y of each output, in the end how far
    it lies beyond its range.
    """
    n = head[0]
    terms = head[1]
    bits = head[3]
    k = 5 + head[2]
    standardise(x, ids, feats, n, bits, u, high, low)
    multiply(steps, n, terms, bits, u, high, low)
    predict(c, d, rows, outs, terms, bits, high, low, work, out)
    doubt(c, d, 5 * terms, rows, outs, k, bits, head[5], head[10], high, low, work, out)
    out[16] = distance(c, 5 * (terms + k), rows, n, high)


def verdict(x, ids, feats, limits, head, work, out):
    """Flags from the features and from what `compute` left in `work` and `out`; returns a status."""
    out[17] = head[8]
    flags = 1
    at = 0
    for i in range(head[4]):
        v = x[limits[at]]
        if v < limits[at + 1] or v > limits[at + 2]:
            flags = 0
        at += 3
    inside = out[16] <= 1000
    at = 0
    for i in range(head[0]):
        v = x[ids[i]]
        if v < feats[at + 5] or v > feats[at + 6]:
            inside = False
        at += 7
    for j in range(5):
        if work[j] > 0:
            inside = False
    if inside:
        flags |= 2
    if flags & 1 == 0:
        for i in range(15):
            out[i] = 0
        out[15] = flags
        return NO_LUMP
    if out[14] < head[5]:
        flags |= 8
    elif out[13] >= head[5]:
        flags |= 4
    if out[0] < head[6] or out[0] > head[7]:
        flags |= 16
    out[15] = flags
    return 0


def middle(lo, hi):
    """Entries Y_MID and Y_SHIFT of an output whose predictions lie between lo and hi."""
    mid = (lo + hi) >> 1
    half = hi - mid
    shift = -28
    while half:
        half >>= 1
        shift += 1
    return mid, shift


def scaling(lo, hi, centre):
    """Entries SHIFT and FACTOR of a feature: what takes x - centre into +-1 in Q28. Needs long integers."""
    half = max(hi - centre, centre - lo, 1)
    shift = 0
    while half << shift <= 1 << 27:
        shift += 1
    while half > 1 << 28 - shift:
        shift -= 1
    size = half << shift if shift >= 0 else half >> -shift
    return -shift, ((1 << 56) + (size >> 1)) // size


class Tables:
    """A model as arrays; `evaluate(features, out)` is all that a probe does with it."""

    def __init__(self, ids, feats, steps, c, d, rows, outs, limits, head):
        self.ids = ids
        self.feats = feats
        self.steps = steps
        self.c = c
        self.d = d
        self.rows = rows
        self.outs = outs
        self.limits = limits
        self.head = head
        n = head[N_TERMS]
        self.u = array("i", bytearray(4 * n))
        self.high = array("h", bytearray(2 * (n + OUTPUTS)))
        self.low = array("h", bytearray(2 * (n + OUTPUTS)))
        self.work = array("i", bytearray(4 * OUTPUTS))

    def evaluate(self, x, out):
        """Estimate from the features x (array 'i', Q24, all of the firmware's) into out (OUT_SIZE integers).

        Returns OK, or NO_LUMP with zeros for the outputs; the flags stand in out[FLAGS] in either case.
        """
        compute(
            x, self.ids, self.feats, self.steps, self.c, self.d, self.rows, self.outs, self.head,
            self.u, self.high, self.low, self.work, out,
        )  # fmt: skip
        return verdict(x, self.ids, self.feats, self.limits, self.head, self.work, out)
