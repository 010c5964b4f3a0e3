"""The model's arithmetic: features in, the five outputs with their intervals out, integers only.

`Tables` holds a model as arrays; `evaluate` works on arrays the caller owns and allocates nothing.
`compute` has no branch on data other than `clip` and `pick`, so the exporter runs this very code on
intervals to prove that no intermediate leaves +-2^30 (model_export/bounds.py).

Numbers: features Q24; u, a feature moved and scaled into +-1 over the model's clip box, Q28; predictions y,
ln sigma and widths on the link scale Q24; outputs in millionths.

Sums: a coefficient is a high word c and a low word d; of an input (u of a feature, or a product of such)
there are `part`, its first 18 to 20 bits, and `high`, its first 13. A term of a sum is c * part and, shifted
to the same scale, d * high: two products. Where coefficients are so large that c leaves room for 13 bits
alone the model is `fine`: products of features are taken in Q28, `high` stands for `part`, and the next bits
of an input, `rest`, meet c in a third product.
"""

from array import array

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
LOW_BITS = 3  # of a coefficient's low word, at most 13
N_LIMITS = 4
HARD_BELOW = 5  # millionths of E_inv23
FORCE_LO = 6  # millionths of N/m
FORCE_HI = 7
LEVEL_PERMILLE = 8
LINKS = 9  # bit j: output j has a ln link
MARGIN = 10  # how far beyond its range an estimate may lie, in 1/256 of half its interval
PART_BITS = 11  # of an input: 18 to 20, or 13
FINE = 12  # 1 where they are 13
GROUP_SHIFT = 13  # what each group's sum of the outputs is shifted down by
GROUPS = 14  # how many; then for each group the input after its last
HEAD = 15

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

# c and d: five words for each term (one an output), five for each input of ln sigma; c also the rows of the
# distance, a lower triangle

_MAX_LN_WIDTH = 34887240  # ln 8
_MIN_LN_WIDTH = -268435456  # -16: a width below 2e-7
NO_WIDTH = -536870912  # stands for ln 0

# 2^(i / 64) in Q24, 4.3e-7 larger: what `exp` rounds down on the way, on average
_POWERS = (
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
    m = _POWERS[k & 63]
    w = v >> 3
    v += w * w >> 19
    m += (m >> 10) * (v >> 3) >> 11
    s -= k >> 6
    if s > 0:
        return m + (1 << s - 1) >> s if s < 31 else 0
    return m << -s if s > -5 else 0x3FFFFFFF


def sums(c, d, at, part, high, rest, first, last, cut, fine, down, work):
    """Add five sums over the inputs `first` to `last` to work[0..4]; their words begin at `at`.

    All five at once: an input is read once, and a look-up costs as much as a product.
    """
    a0 = a1 = a2 = a3 = a4 = 0
    b0 = b1 = b2 = b3 = b4 = 0
    if fine:
        part = high
    i = at
    for k in range(first, last):
        v = part[k]
        h = high[k]
        a0 += c[i] * v
        b0 += d[i] * h
        i += 1
        a1 += c[i] * v
        b1 += d[i] * h
        i += 1
        a2 += c[i] * v
        b2 += d[i] * h
        i += 1
        a3 += c[i] * v
        b3 += d[i] * h
        i += 1
        a4 += c[i] * v
        b4 += d[i] * h
        i += 1
    if fine:
        i = at
        for k in range(first, last):
            v = rest[k]
            b0 += c[i] * v
            b1 += c[i + 1] * v
            b2 += c[i + 2] * v
            b3 += c[i + 3] * v
            b4 += c[i + 4] * v
            i += 5
    work[0] += a0 + (b0 >> cut) >> down
    work[1] += a1 + (b1 >> cut) >> down
    work[2] += a2 + (b2 >> cut) >> down
    work[3] += a3 + (b3 >> cut) >> down
    work[4] += a4 + (b4 >> cut) >> down


def dot_high(c, at, high, first, n):
    """One sum with high parts alone, good to 1e-3 of the largest coefficient."""
    a = 0
    for k in range(first, first + n):
        a += c[at] * high[k]
        at += 1
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


def put(v, k, head, part, high, rest):
    """Keep a Q28 number as input k."""
    high[k] = v >> 15
    if head[12]:
        rest[k] = (v >> 15 - head[3]) & ((1 << head[3]) - 1)
    else:
        part[k] = v >> 28 - head[11]


def standardise(x, ids, feats, head, u, part, high, rest):
    """The features as u, within +-1 over the clip box."""
    at = 0
    for i in range(head[0]):
        v = clip(x[ids[i]], feats[at], feats[at + 1]) - feats[at + 2]
        w = feats[at + 3]
        v = v << -w if w < 0 else v >> w
        w = feats[at + 4]
        v = (v >> 14) * w + ((v & 16383) * w >> 14)
        u[i] = v
        put(v, 5 + i, head, part, high, rest)
        at += 7


def multiply(steps, first, last, cut, part, high):
    """The other inputs: each an input before it times a feature."""
    at = 0
    for k in range(first, last):
        v = part[steps[at] + 5]
        w = part[steps[at + 1] + 5]
        v = v * (w >> 10) + (v * (w & 1023) >> 10) >> cut + 3
        part[k] = v
        high[k] = v >> cut
        at += 2


def multiply_fine(steps, n, terms, bits, u, high, rest):
    """The same in Q28."""
    at = 0
    k = 5 + n
    mask = (1 << bits) - 1
    down = 15 - bits
    for i in range(n, terms):
        v = u[steps[at]]
        w = u[steps[at + 1]]
        a = v >> 14
        b = w >> 14
        # the product of the two low halves is below what is kept
        v = a * b + ((a * (w & 16383) + b * (v & 16383)) >> 14)
        u[i] = v
        high[k] = v >> 15
        rest[k] = (v >> down) & mask
        at += 2
        k += 1


def predict(c, d, rows, outs, head, part, high, rest, work, out):
    """The outputs; their predictions, clipped, stay in work[5..9] and become inputs 0 to 4."""
    cut = head[3] + 13 - head[11]
    for j in range(5):
        work[j] = 0
    first = 5
    at = 0
    for g in range(15, 15 + head[14]):
        last = head[g]
        sums(c, d, at, part, high, rest, first, last, cut, head[12], head[13], work)
        at += 5 * (last - first)
        first = last
    at = 0
    for j in range(5):
        v = work[j]
        s = rows[2 * j + 1]
        v = clip((v >> s if s > 0 else scaled(v, s)) + rows[2 * j], outs[at + 1], outs[at + 2])
        work[5 + j] = v
        out[3 * j] = value(v, outs[at])
        put(scaled(v - outs[at + 3], outs[at + 4]), j, head, part, high, rest)
        at += 9


def doubt(c, d, at, rows, outs, head, part, high, rest, work, out):
    """The intervals: a quantile for the predicted class times sigma, on the link scale.

    In work[0..4] they leave how far each prediction lies beyond its range and the margin.
    """
    for j in range(5):
        work[j] = 0
    sums(c, d, at, part, high, rest, 0, 5 + head[2], head[3] + 13 - head[11], head[12], 0, work)
    at = 0
    e = out[12]
    for j in range(5):
        v = work[j]
        s = rows[2 * j + 11]
        v = clip((v >> s if s > 0 else scaled(v, s)) + rows[2 * j + 10], _MIN_LN_WIDTH, _MAX_LN_WIDTH)
        v = width(v + pick(e, head[5], outs[at + 6], outs[at + 5]))
        y = work[5 + j]
        out[3 * j + 1] = value(clip(y - v, outs[at + 1], outs[at + 2]), outs[at])
        out[3 * j + 2] = value(clip(y + v, outs[at + 1], outs[at + 2]), outs[at])
        below = outs[at + 7] - y
        above = y - outs[at + 8]
        work[j] = pick(above - below, 0, below, above) - (v >> 8) * head[10]
        at += 9


def distance(c, at, rows, n, high):
    """Squared distance from the domain's centre, as permille of its edge's."""
    total = 0
    row = 20
    for i in range(n):
        v = dot_high(c, at, high, 5, i + 1)
        s = rows[row + 1]
        v = clip((v >> s if s > 0 else scaled(v, s)) + rows[row], -16384, 16384)
        total += v * v >> 3
        at += i + 1
        row += 2
    return (total >> 11) * 1000 >> 10


def compute(x, ids, feats, steps, c, d, rows, outs, head, u, part, high, rest, work, out):
    """All outputs and intervals into `out`, and the distance from the domain's centre.

    part, high and rest hold the predictions first, then the terms; work[0..4] in the end how far each
    prediction lies beyond its range.
    """
    n = head[0]
    terms = head[1]
    standardise(x, ids, feats, head, u, part, high, rest)
    if head[12]:
        multiply_fine(steps, n, terms, head[3], u, high, rest)
    else:
        multiply(steps, 5 + n, 5 + terms, head[11] - 13, part, high)
    predict(c, d, rows, outs, head, part, high, rest, work, out)
    doubt(c, d, 5 * terms, rows, outs, head, part, high, rest, work, out)
    out[16] = distance(c, 5 * (terms + 5 + head[2]), rows, n, high)


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
    """Entries SHIFT and FACTOR of a feature: what takes x - centre into +-1 in Q28."""
    half = max(hi - centre, centre - lo, 1)
    shift = 0
    while half << shift <= 1 << 27:
        shift += 1
    while half > 1 << 28 - shift:
        shift -= 1
    size = half << shift if shift >= 0 else half >> -shift
    # the factor has 16 bits; +-1 is missed by 2^-9, so that no product of two reaches 1
    return -shift, (1 << 28) * 16352 // size


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
        n = head[N_TERMS] + OUTPUTS
        fine = head[FINE]
        self.u = array("i", bytearray(4 * head[N_TERMS if fine else N_FEATURES]))
        self.part = array("i", bytearray(4 * (1 if fine else n)))
        self.high = array("h", bytearray(2 * n))
        self.rest = array("h", bytearray(2 * (n if fine else 1)))
        self.work = array("i", bytearray(8 * OUTPUTS))

    def evaluate(self, x, out):
        """Estimate from the features x (array 'i', Q24, all of the firmware's) into out (OUT_SIZE integers).

        Returns OK, or NO_LUMP with zeros for the outputs; the flags stand in out[FLAGS] in either case.
        """
        compute(
            x, self.ids, self.feats, self.steps, self.c, self.d, self.rows, self.outs, self.head,
            self.u, self.part, self.high, self.rest, self.work, out,
        )  # fmt: skip
        return verdict(x, self.ids, self.feats, self.limits, self.head, self.work, out)
