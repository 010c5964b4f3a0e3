"""The model's arithmetic: features in, the five outputs with their intervals out, integers only.

`Tables` holds a model as arrays; `evaluate` works on arrays the caller owns and allocates nothing.
`compute` has no branch on data other than those in scales.py, so the exporter runs this very code on
intervals to prove that no intermediate leaves +-2^30 (model_export/bounds.py).

Numbers: features Q24; u, a feature moved and scaled into +-1 over the model's clip box, Q28; predictions y,
ln sigma and widths on the link scale Q24; outputs in millionths. The polynomials: polynomial.py.
"""

from array import array

from firmware_py import polynomial, scales
from firmware_py import verdict as _verdict

clip = scales.clip
pick = scales.pick
scaled = scales.scaled
value = scales.value
width = scales.width
verdict = _verdict.verdict

OUTPUTS = 5
NO_LUMP = _verdict.NO_LUMP
WORK = 20  # sums of three depths, then the predictions
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
LEAVES = 1  # terms that go no further
DOWNS = 2  # what each output's runs are shifted down by, four bits each, and ln sigma's
LOW_BITS = 3  # of a coefficient's low word
N_LIMITS = 4
HARD_BELOW = 5  # millionths of E_inv23
FORCE_LO = 6  # millionths of N/m
FORCE_HI = 7
LEVEL_PERMILLE = 8
LINKS = 9  # bit j: output j has a ln link
MARGIN = 10  # how far beyond its range an estimate may lie, in 1/256 of half its interval
PART_BITS = 11  # of an input, that high words meet
HIGH_BITS = 12  # of an input, that low words meet
STEPS = 13  # bytes of the outputs' program; behind it ln sigma's runs
HEAD = 14

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

# c and d: five words for each leaf (one an output) in the order of the program, five for each input of
# ln sigma, the predictions first; c also the rows of the distance, a lower triangle. own: five for each
# branch

NO_WIDTH = -536870912  # stands for ln 0


def put(v, k, head, part, high):
    """Keep a Q28 number as input k."""
    s = 28 - head[11]
    part[k] = v + (1 << s - 1) >> s
    s = 28 - head[12]
    high[k] = v + (1 << s - 1) >> s


def standardise(x, ids, feats, head, u, part, high):
    """The features as u, within +-1 over the clip box."""
    s = 28 - head[11]
    half = 1 << s - 1
    t = 28 - head[12]
    other = 1 << t - 1
    at = 0
    for i in range(head[0]):
        v = clip(x[ids[i]], feats[at], feats[at + 1]) - feats[at + 2]
        w = feats[at + 3]
        v = v << -w if w < 0 else v >> w
        w = feats[at + 4]
        v = (v >> 14) * w + ((v & 16383) * w >> 14)
        u[i] = v
        part[5 + i] = v + half >> s
        high[5 + i] = v + other >> t
        at += 7


def predict(c, d, own, steps, rows, outs, head, u, part, high, work, out):
    """The outputs; their predictions, clipped, stay in work[15..19] and become inputs 0 to 4."""
    polynomial.nested(c, d, own, steps, u, part, high, head, work)
    at = 0
    for j in range(5):
        v = work[j]
        s = rows[2 * j + 1]
        v = clip((v >> s if s > 0 else scaled(v, s)) + rows[2 * j], outs[at + 1], outs[at + 2])
        work[15 + j] = v
        out[3 * j] = value(v, outs[at])
        put(scaled(v - outs[at + 3], outs[at + 4]), j, head, part, high)
        at += 9


def doubt(c, d, steps, rows, outs, head, part, high, work, out):
    """The intervals: a quantile for the predicted class times sigma, on the link scale.

    In work[0..4] they leave how far each prediction lies beyond its range and the margin.
    """
    for j in range(5):
        work[j] = 0
    at = 5 * head[1]
    cut = head[3] + head[12] - head[11]
    downs = (head[2] >> 20) * 69905  # five times the same
    i = head[13]
    while i < len(steps):
        n = steps[i] & 31
        i += 1
        polynomial.sums(c, d, at, part, high, steps, i, i + n, cut, downs, work, 0)
        i += n
        at += 5 * n
    at = 0
    e = out[12]
    for j in range(5):
        v = work[j]
        s = rows[2 * j + 11]
        v = (v >> s if s > 0 else scaled(v, s)) + rows[2 * j + 10]
        v = clip(v, scales.MIN_LN_WIDTH, scales.MAX_LN_WIDTH)
        v = width(v + pick(e, head[5], outs[at + 6], outs[at + 5]))
        y = work[15 + j]
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
        v = polynomial.dot_high(c, at, high, 5, i + 1)
        s = rows[row + 1]
        v = clip((v >> s if s > 0 else scaled(v, s)) + rows[row], -16384, 16384)
        total += v * v >> 3
        at += i + 1
        row += 2
    return (total >> 11) * 1000 >> 10


def compute(x, ids, feats, steps, c, d, own, rows, outs, head, u, part, high, work, out):
    """All outputs and intervals into `out`, and the distance from the domain's centre.

    part and high hold the predictions first, then the features; work[0..4] in the end how far each prediction
    lies beyond its range.
    """
    n = head[0]
    standardise(x, ids, feats, head, u, part, high)
    predict(c, d, own, steps, rows, outs, head, u, part, high, work, out)
    doubt(c, d, steps, rows, outs, head, part, high, work, out)
    out[16] = distance(c, 5 * (head[1] + 5 + n), rows, n, high)


class Tables:
    """A model as arrays; `evaluate(features, out)` is all that a probe does with it."""

    def __init__(self, ids, feats, steps, c, d, own, rows, outs, limits, head):
        self.ids = ids
        self.feats = feats
        self.steps = steps
        self.c = c
        self.d = d
        self.own = own
        self.rows = rows
        self.outs = outs
        self.limits = limits
        self.head = head
        n = head[N_FEATURES]
        self.u = array("i", bytearray(4 * n))
        self.part = array("i", bytearray(4 * (n + OUTPUTS)))
        self.high = array("i", bytearray(4 * (n + OUTPUTS)))
        self.work = array("i", bytearray(4 * WORK))

    def evaluate(self, x, out):
        """Estimate from the features x (array 'i', Q24, all of the firmware's) into out (OUT_SIZE integers).

        Returns OK, or NO_LUMP with zeros for the outputs; the flags stand in out[FLAGS] in either case.
        """
        compute(
            x, self.ids, self.feats, self.steps, self.c, self.d, self.own, self.rows, self.outs, self.head,
            self.u, self.part, self.high, self.work, out,
        )  # fmt: skip
        return verdict(x, self.ids, self.feats, self.limits, self.head, self.work, out)
