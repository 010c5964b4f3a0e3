"""The model's arithmetic: features in, the outputs with their intervals out, integers only.

`Tables` holds a model as arrays; `evaluate` works on arrays the caller owns and allocates nothing.
`compute` has no branch on data other than those in scales.py, so the exporter runs this very code on
intervals to prove that no intermediate leaves +-2^30 (model_export/integers/bounds.py).

Numbers: features Q24; u, a feature moved and scaled into +-1 over the model's clip box, Q28; predictions y,
ln sigma and widths on the link scale Q24; outputs in millionths. The polynomials: polynomial.py.
"""

from array import array

from firmware_py import constant, outputs, polynomial, scales
from firmware_py import verdict as _verdict

const = constant.const
clip = scales.clip
pick = scales.pick
scaled = scales.scaled
value = scales.value
width = scales.width
verdict = _verdict.verdict

# Numbers of this module stand in its loops as they are (constant.py); those that outputs.py and verdict.py
# have as well are held equal by a test, and `python -m tests.firmware_py.output_numbers` writes them.
OUTPUTS = const(6)
NO_LUMP = _verdict.NO_LUMP
WORK = const(24)  # sums of three depths, of which the predictions remain, then of ln sigma
SIGMAS = const(18)
OUT_SIZE = const(21)  # value, low, high of each output; then FLAGS, DISTANCE, LEVEL
FLAGS = const(18)
DISTANCE = const(19)
LEVEL = const(20)

LUMP = outputs.LUMP
IN_DOMAIN = outputs.IN_DOMAIN
SOFT = outputs.SOFT
HARD = outputs.HARD
FORCE_OUT = outputs.FORCE_OUT

# head: what `compute` and `verdict` need of the model, one integer each
N_FEATURES = const(0)
LEAVES = const(1)  # terms that go no further
DOWNS = const(2)  # what each output's runs are shifted down by, four bits each, and ln sigma's
ALL_DOWNS = const(0xFFFFFF)  # four bits for each of them
SIGMA_DOWN = const(24)  # the place of ln sigma's, behind the outputs'
ALIKE = const(0x111111)  # times four bits: the same for each output
LOW_BITS = const(3)  # of a coefficient's low word
N_LIMITS = const(4)
HARD_BELOW = const(5)  # millionths of E_inv23
FORCE_LO = const(6)  # millionths of N/m
FORCE_HI = const(7)
LEVEL_PERMILLE = const(8)
LINKS = const(9)  # bit j: output j has a ln link; those with a scale of their own: unpack.links
MARGIN = const(10)  # how far beyond its range an estimate may lie, in 1/256 of its interval's half-width
PART_BITS = const(11)  # of an input, that high words meet
HIGH_BITS = const(12)  # of an input, that low words meet
STEPS = const(13)  # bytes of the outputs' program; behind it ln sigma's runs
SUMS = const(14)  # polynomials that are worked out at once: here OUTPUTS, of a stage as many as it has values
HEAD = const(15)

# feature table: one row of seven for each feature
CLIP_LO = const(0)
CLIP_HI = const(1)
CENTRE = const(2)
SHIFT = const(3)
FACTOR = const(4)
BOX_LO = const(5)
BOX_HI = const(6)
FEATURE_ROW = const(7)

# output table: one row of nine for each output
LINK = const(0)  # see scales.value
Y_LO = const(1)
Y_HI = const(2)
Y_MID = const(3)  # and the shift that takes y - Y_MID into +-1 in Q28
Y_SHIFT = const(4)
LN_Q_SOFT = const(5)  # ln of the conformal quantile for each predicted class
LN_Q_HARD = const(6)
RANGE_LO = const(7)  # what the model is for, on the link scale; where there is no such end, Y_LO or Y_HI
RANGE_HI = const(8)
E_OUTPUT = const(4)  # which output the hardness rule looks at
OUTPUT_ROW = const(9)

# row table: intercept (Q24) and shift of each sum: outputs, ln sigmas, whitened coordinates
ROW = const(2)

# c and d: a word an output for each leaf, in the order of the program, and for each input of ln sigma, the
# predictions first; c also the rows of the distance, a lower triangle. own: one an output for each branch

NO_WIDTH = const(-536870912)  # stands for ln 0


def put(v, k, head, part, high):
    """Keep a Q28 number as input k."""
    s = 28 - head[PART_BITS]
    part[k] = v + (1 << s - 1) >> s
    s = 28 - head[HIGH_BITS]
    high[k] = v + (1 << s - 1) >> s


def standardise(x, ids, feats, head, u, part, high):
    """The features as u, within +-1 over the clip box."""
    s = 28 - head[PART_BITS]
    half = 1 << s - 1
    t = 28 - head[HIGH_BITS]
    other = 1 << t - 1
    at = 0
    for i in range(head[N_FEATURES]):
        v = clip(x[ids[i]], feats[at + CLIP_LO], feats[at + CLIP_HI]) - feats[at + CENTRE]
        w = feats[at + SHIFT]
        v = v << -w if w < 0 else v >> w
        w = feats[at + FACTOR]
        v = (v >> 14) * w + ((v & 16383) * w >> 14)
        u[i] = v
        part[OUTPUTS + i] = v + half >> s
        high[OUTPUTS + i] = v + other >> t
        at += FEATURE_ROW


def predict(c, d, own, steps, rows, outs, head, u, part, high, work, out):
    """The outputs; their predictions, clipped, stay at the beginning of work and become the first inputs."""
    for j in range(WORK):
        work[j] = 0
    polynomial.nested(
        c, d, own, steps, u, part, high, head, work, 0, head[STEPS], 0, head[DOWNS] & ALL_DOWNS
    )  # fmt: skip
    at = 0
    for j in range(OUTPUTS):
        v = work[j]
        s = rows[2 * j + 1]
        v = clip((v >> s if s > 0 else scaled(v, s)) + rows[2 * j], outs[at + Y_LO], outs[at + Y_HI])
        work[j] = v
        out[3 * j] = value(v, outs[at + LINK])
        put(scaled(v - outs[at + Y_MID], outs[at + Y_SHIFT]), j, head, part, high)
        at += OUTPUT_ROW


def intervals(c, d, steps, rows, outs, head, part, high, work, out):
    """The intervals: a quantile for the predicted class times sigma, on the link scale.

    They leave in each prediction's place in work how far it lies beyond its range and the margin.
    """
    polynomial.nested(
        c, d, steps, steps, part, part, high, head, work, head[STEPS], len(steps), OUTPUTS * head[LEAVES],
        (head[DOWNS] >> SIGMA_DOWN) * ALIKE,
    )  # fmt: skip
    at = 0
    e = out[3 * E_OUTPUT]
    for j in range(OUTPUTS):
        v = work[SIGMAS + j]
        s = rows[2 * (OUTPUTS + j) + 1]
        v = (v >> s if s > 0 else scaled(v, s)) + rows[2 * (OUTPUTS + j)]
        v = clip(v, scales.MIN_LN_WIDTH, scales.MAX_LN_WIDTH)
        v = width(v + pick(e, head[HARD_BELOW], outs[at + LN_Q_HARD], outs[at + LN_Q_SOFT]))
        y = work[j]
        out[3 * j + 1] = value(clip(y - v, outs[at + Y_LO], outs[at + Y_HI]), outs[at + LINK])
        out[3 * j + 2] = value(clip(y + v, outs[at + Y_LO], outs[at + Y_HI]), outs[at + LINK])
        below = outs[at + RANGE_LO] - y
        above = y - outs[at + RANGE_HI]
        work[j] = pick(above - below, 0, below, above) - (v >> 8) * head[MARGIN]
        at += OUTPUT_ROW


def distance(c, at, rows, n, high):
    """Squared distance from the domain's centre, as permille of its edge's."""
    total = 0
    row = 2 * 2 * OUTPUTS
    for i in range(n):
        v = polynomial.dot_high(c, at, high, OUTPUTS, i + 1)
        s = rows[row + 1]
        v = clip((v >> s if s > 0 else scaled(v, s)) + rows[row], -16384, 16384)
        total += v * v >> 3
        at += i + 1
        row += 2
    return (total >> 11) * 1000 >> 10


def compute(x, ids, feats, steps, c, d, own, rows, outs, head, u, part, high, work, out):
    """All outputs and intervals into `out`, and the distance from the domain's centre.

    part and high hold the predictions first, then the features; `work` in the end begins with how far each
    prediction lies beyond its range.
    """
    n = head[N_FEATURES]
    standardise(x, ids, feats, head, u, part, high)
    predict(c, d, own, steps, rows, outs, head, u, part, high, work, out)
    intervals(c, d, steps, rows, outs, head, part, high, work, out)
    out[DISTANCE] = distance(c, OUTPUTS * (head[LEAVES] + OUTPUTS + n), rows, n, high)


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
        head[SUMS] = OUTPUTS
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


class Model:
    """A model ready to evaluate (model_image.load), which needs nothing any more of what has loaded it.

    force_map: what forcemap.load returned, or None; tested: place and length of the vectors in its image;
    first: stage.Stage of a model of two stages; checks: of one that has them.
    """

    def __init__(self, tables, force_map, header, tested):
        self.tables = tables
        self.force_map = force_map
        self.tested = tested
        self.evaluate = tables.evaluate
        self.first = None
        self.checks = None
        self.model_id = header.model_id
        self.kind = header.kind
        self.counter = header.counter
        self.rollback = header.rollback
        self.replaces = header.replaces
