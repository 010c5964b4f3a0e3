"""A model's first stage: polynomials of some features whose values its second takes as features.

What the press tells of the tissue is worked out so, before the stroke is looked at; a model's checks are such
polynomials too. The arithmetic is the second stage's (evaluator.py, polynomial.py); docs/model-image.md has
the formulas. Loaded only where the live model has two stages, or checks (stage_image.py).
"""

from array import array

from firmware_py import constant, evaluator, features, outputs, polynomial, scales

const = constant.const

clip = scales.clip
scaled = scales.scaled
standardise = evaluator.standardise

MOST = const(3)  # values
ENDS = const(2)  # least and greatest of each
LN_FORCE = const(6)  # its place in feature_names.NAMES: a test holds them equal
_PRESS = const(30)  # features.PRESS, likewise
_ABSENT = features.ABSENT

# how a reference press (reference.py) joins a stroke's own: the weight of each of its values, Q14; the rows
# of the lower triangle that turns differences into independent ones of spread 1, Q6; the greatest square, Q20
WEIGHTS = const(0)
TRIANGLE = const(3)
LIMIT = const(9)
REFERS = const(10)
_HALF = const(8388607)  # .5: of a difference
_FARTHEST = const(16384)  # 16: of an independent difference, Q10


def estimates(x, ids, feats, steps, c, d, own, rows, ends, head, u, part, high, work, to, count):
    """The stage's values, Q24, into x[to..to+count)."""
    standardise(x, ids, feats, head, u, part, high)
    for j in range(3 * count):
        work[j] = 0
    polynomial.nested(
        c, d, own, steps, u, part, high, head, work, 0, len(steps), 0, head[evaluator.DOWNS]
    )  # fmt: skip
    for j in range(count):
        v = work[j]
        s = rows[2 * j + 1]
        v = (v >> s if s > 0 else scaled(v, s)) + rows[2 * j]
        x[to + j] = clip(v, ends[ENDS * j], ends[ENDS * j + 1])


def join(x, at, reference, refers, ends):
    """Move the values at x[at..] towards those of the reference; False, and they stay, where they do not fit.

    reference: ln reach less ln force, so that any force may be added again; the other two as they are.
    """
    limit = refers[LIMIT]
    square = 0
    k = TRIANGLE
    for i in range(MOST):
        z = 0
        for j in range(i + 1):
            d = reference[j] - x[at + j] + (0 if j else x[LN_FORCE])
            z += (clip(d, -_HALF, _HALF) >> 10) * refers[k]
            k += 1
        z = clip(z >> 10, -_FARTHEST, _FARTHEST)
        square += z * z
    if square > limit:
        return False
    for j in range(MOST):
        d = reference[j] - x[at + j] + (0 if j else x[LN_FORCE])
        v = x[at + j] + ((clip(d, -_HALF, _HALF) >> 8) * refers[WEIGHTS + j] >> 6)
        x[at + j] = clip(v, ends[ENDS * j], ends[ENDS * j + 1])
    return True


class Stage:
    """The stage as arrays, like evaluator.Tables; `count` values of `feature_count` features.

    refers: as above, or empty where the model takes no reference; `held`: whether there is one.
    of_press: bit j: value j has features of the press; without a press it says nothing.
    """

    def __init__(
        self, ids, feats, steps, c, d, own, rows, ends, head, count, feature_count, refers=(), of_press=0
    ):
        self.ids = ids
        self.feats = feats
        self.steps = steps
        self.c = c
        self.d = d
        self.own = own
        self.rows = rows
        self.ends = ends
        self.head = head
        self.count = count
        self.feature_count = feature_count
        n = head[evaluator.N_FEATURES]
        self.u = array("i", bytearray(4 * n))
        self.part = array("i", bytearray(4 * (n + evaluator.OUTPUTS)))
        self.high = array("i", bytearray(4 * (n + evaluator.OUTPUTS)))
        head[evaluator.SUMS] = count
        self.work = array("i", bytearray(4 * 3 * count))  # three depths
        self.x = array("i", bytearray(4 * (feature_count + MOST)))
        self.refers = refers
        self.reference = array("i", bytearray(4 * MOST if refers else 0))
        self.held = False
        self.of_press = of_press

    def extend(self, x):
        """The features x, and behind them the stage's values, in the stage's own array. Allocates nothing."""
        n = self.feature_count
        for i in range(n):
            self.x[i] = x[i]
        estimates(
            self.x, self.ids, self.feats, self.steps, self.c, self.d, self.own, self.rows, self.ends,
            self.head, self.u, self.part, self.high, self.work, n, self.count,
        )  # fmt: skip
        return self.x

    def keep(self, x):
        """What `extend` has made of a reference press is the reference from here on."""
        self.set(x[self.feature_count] - x[LN_FORCE], x[self.feature_count + 1], x[self.feature_count + 2])

    def set(self, *values):
        """The reference: ln reach less ln force, ln t, ln layers."""
        for j in range(MOST):
            self.reference[j] = values[j]
        self.held = True

    def refer(self, x):
        """Join the reference to what `extend` gave; the flags that tell so. Allocates nothing."""
        if not self.held or x[_PRESS] == _ABSENT:
            return 0
        fits = join(x, self.feature_count, self.reference, self.refers, self.ends)
        return outputs.REFERENCE if fits else outputs.REFERENCE_OFF


class Staged:
    """Both stages as one: `evaluate` is what evaluator.Tables has."""

    def __init__(self, first, tables):
        self.first = first
        self.tables = tables

    def evaluate(self, x, out):
        """Estimate from the features x into out; see evaluator.Tables.evaluate."""
        x = self.first.extend(x)
        flags = self.first.refer(x)
        code = self.tables.evaluate(x, out)
        out[evaluator.FLAGS] |= flags
        return code


class Checked:
    """A model with checks: a stroke where one of them is above zero is outside the domain.

    Where there was no press, or too little of one, those of the press are passed over.
    first: the first stage, or None; what it and `checks` extend lies behind each other.
    """

    def __init__(self, checks, first, tables):
        self.checks = checks
        self.first = first
        self.tables = tables

    def evaluate(self, x, out):
        """Estimate from the features x into out; see evaluator.Tables.evaluate."""
        flags = 0
        if self.first:
            x = self.first.extend(x)
            flags = self.first.refer(x)
        code = self.tables.evaluate(x, out)
        out[evaluator.FLAGS] |= flags
        checks = self.checks
        x = checks.extend(x)
        unknown = checks.of_press if x[_PRESS] == _ABSENT else 0
        for i in range(checks.count):
            if x[checks.feature_count + i] > 0 and not unknown >> i & 1:
                out[evaluator.FLAGS] &= ~outputs.IN_DOMAIN
        return code
