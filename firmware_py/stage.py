"""A model's first stage: polynomials of some features whose values its second takes as features.

What the press tells of the tissue is worked out so, before the stroke is looked at; a model's checks are such
polynomials too. The arithmetic is the second stage's (evaluator.py, polynomial.py); docs/model-image.md has
the formulas. Loaded only where the live model has two stages, or checks (stage_image.py).
"""

from array import array

from firmware_py import constant, evaluator, outputs, polynomial, scales

const = constant.const

clip = scales.clip
scaled = scales.scaled
standardise = evaluator.standardise

MOST = const(3)  # values
ENDS = const(2)  # least and greatest of each


def estimates(x, ids, feats, steps, c, d, own, rows, ends, head, u, part, high, work, to, count):
    """The stage's values, Q24, into x[to..to+count)."""
    standardise(x, ids, feats, head, u, part, high)
    polynomial.nested(c, d, own, steps, u, part, high, head, work)
    for j in range(count):
        v = work[j]
        s = rows[2 * j + 1]
        v = (v >> s if s > 0 else scaled(v, s)) + rows[2 * j]
        x[to + j] = clip(v, ends[ENDS * j], ends[ENDS * j + 1])


class Stage:
    """The stage as arrays, like evaluator.Tables; `count` values of `feature_count` features."""

    def __init__(self, ids, feats, steps, c, d, own, rows, ends, head, count, feature_count):
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
        self.work = array("i", bytearray(4 * evaluator.WORK))
        self.x = array("i", bytearray(4 * (feature_count + MOST)))

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


class Staged:
    """Both stages as one: `evaluate` is what evaluator.Tables has."""

    def __init__(self, first, tables):
        self.first = first
        self.tables = tables

    def evaluate(self, x, out):
        """Estimate from the features x into out; see evaluator.Tables.evaluate."""
        return self.tables.evaluate(self.first.extend(x), out)


class Checked:
    """A model with checks: a stroke where one of them is above zero is outside the domain.

    first: the first stage, or None; what it and `checks` extend lies behind each other.
    """

    def __init__(self, checks, first, tables):
        self.checks = checks
        self.first = first
        self.tables = tables

    def evaluate(self, x, out):
        """Estimate from the features x into out; see evaluator.Tables.evaluate."""
        if self.first:
            x = self.first.extend(x)
        code = self.tables.evaluate(x, out)
        checks = self.checks
        x = checks.extend(x)
        for i in range(checks.count):
            if x[checks.feature_count + i] > 0:
                out[evaluator.FLAGS] &= ~outputs.IN_DOMAIN
        return code
