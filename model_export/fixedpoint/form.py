"""The form that outputs share, what it makes of a row, and how much room there is in it.

Fractions count binary places; inputs lie within +-1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from palpate.fixedpoint.nested import Close, Run, Step, Term, order
from palpate.fixedpoint.rounding import Nearest, Rounding
from palpate.fixedpoint.word_pairs import ROOM, Floats, Row, Words

MOST_TOGETHER = 700  # terms that are rounded together
ROUNDED, JUDGED = slice(0, None, 2), slice(1, None, 2)  # of the vectors


@dataclass(frozen=True)
class Form:
    """What the outputs share.

    Attributes
    ----------
    part, high : int
        Bits of an input that high and low words meet.
    low : int
        Bits of a low word.
    downs : tuple of int
        What each output's runs are shifted down by.
    steps : tuple of nested.Step
    """

    part: int
    high: int
    low: int
    downs: tuple[int, ...]
    steps: tuple[Step, ...]

    @property
    def low_sum_shift(self) -> int:
        """What takes the sum of the low words' products to the scale of the high words'."""
        return self.low + self.high - self.part

    def up(self, j: int) -> int:
        """What takes output j's coefficient of a branch to the scale of the branch's sum."""
        return self.part - self.low - self.downs[j]

    def own(self, j: int, words: Words, at: int) -> int:
        """Output j's coefficient of a branch (its words stand at `at`) at the scale of the branch's sum."""
        return int((words.high[at] << self.low) + words.low[at]) << self.up(j)


class Inputs:
    """The features at n vectors, as the evaluator has them.

    Parameters
    ----------
    features : array (n, features)
        Within +-1.
    steps : list of nested.Step
        With runs as long as can be.
    """

    def __init__(self, features: Floats, steps: list[Step]) -> None:
        self.u = features
        self.steps = steps
        self.whole = np.floor(features * 2.0**28)
        self._rounded: dict[int, Floats] = {}
        self._roundings: dict[bytes, Rounding | Nearest] = {}

    def rounded(self, bits: int) -> Floats:
        """The first bits of each."""
        if bits not in self._rounded:
            self._rounded[bits] = np.floor(self.whole * 2.0 ** (bits - 28) + 0.5)
        return self._rounded[bits]

    def halves(self, feature: int) -> tuple[Floats, Floats]:
        """A feature's first 14 bits and the next 14."""
        whole = self.whole[:, feature]
        upper = np.floor(whole * 2.0**-14)
        return upper, whole - upper * 2.0**14

    @cached_property
    def terms(self) -> Floats:
        """The terms (n, terms) in float64, in the order of their words, and a column of ones."""
        names = order(self.steps)
        return np.array([np.prod(self.u[:, list(t)], axis=1) for t in (*names, ())]).T

    def rounding(self, sizes: Floats) -> Rounding | Nearest:
        """For rows whose errors count relative to these sizes: the longest terms are rounded first."""
        names = order(self.steps)
        if len(names) > MOST_TOGETHER:
            return Nearest()
        first = sorted(range(len(names)), key=lambda k: -len(names[k]))
        known = sizes.tobytes()
        if known not in self._roundings:
            self._roundings[known] = Rounding(
                (self.terms / sizes[:, None])[ROUNDED], np.array([*first, len(names)])
            )
        return self._roundings[known]


def predicted(words: Words, form: Form, j: int, inputs: Inputs) -> Floats:
    """What the evaluator makes of a row of Q24, on the link scale."""
    part, high = inputs.rounded(form.part), inputs.rounded(form.high)
    deepest = max((len(step.branch) for step in inputs.steps), default=0)
    sums = [np.zeros(len(part)) for _ in range(deepest + 1)]
    at = 0
    for step in inputs.steps:
        depth = len(step.branch)
        if isinstance(step, Run):
            k = slice(at, at + len(step.features))
            columns = list(step.features)
            lesser = np.floor((high[:, columns] @ words.low[k]) * 2.0**-form.low_sum_shift)
            sums[depth] += np.floor((part[:, columns] @ words.high[k] + lesser) * 2.0 ** -form.downs[j])
        else:
            k = slice(at, at + 1)
            u, v = inputs.halves(step.branch[-1]), sums[depth] + float(form.own(j, words, at))
            w = np.floor(v * 2.0**-14)
            lesser = u[0] * (v - w * 2.0**14) + u[1] * w
            sums[depth - 1] += u[0] * w + np.floor(lesser * 2.0**-14)
            sums[depth] = np.zeros(len(part))
        at = k.stop
    return np.asarray((sums[0] * 2.0**-words.shift + words.intercept) / 2.0**24)


def _sizes(steps: list[Step], row: Row) -> dict[Term, float]:
    """How large each branch's value can get; () is the whole."""
    sizes: dict[Term, float] = {}
    at = 0
    for step in steps:
        terms = step.terms
        size = np.abs(row.coefficients[at : at + len(terms)]).sum()
        at += len(terms)
        sizes[step.branch] = sizes.get(step.branch, 0.0) + size
        if isinstance(step, Close):
            outer = step.branch[:-1]
            sizes[outer] = sizes.get(outer, 0.0) + sizes[step.branch]
    return sizes


def least_down(steps: list[Step], row: Row, bits: int) -> int:
    """The least shift with which branches stay below 2^29 and the whole below 2^30, at so many places."""
    sizes = _sizes(steps, row)
    inner = max((2 * size for branch, size in sizes.items() if branch), default=0.0)
    most = max(inner, sizes.get((), 0.0), 1e-9) * 2.0**bits
    return max(int(np.ceil(np.log2(most / ROOM))), 0)


def with_room(form: Form, words: list[Words], steps: Sequence[Step]) -> tuple[Step, ...] | None:
    """The steps with runs cut where a sum could overflow; None if a single leaf would."""
    first = np.abs([w.high for w in words]) * 1.001 * 2.0**form.part
    second = np.abs([w.low for w in words]) * 1.001 * 2.0**form.high
    sizes = np.vstack([first + second * 2.0**-form.low_sum_shift, second])
    out: list[Step] = []
    at = 0
    for step in steps:
        if isinstance(step, Run):
            held, n = np.zeros(len(sizes)), 0
            for size in sizes[:, at : at + len(step.features)].T:
                if size.max() >= ROOM:
                    return None
                held, n = held + size, n + 1
                if held.max() >= ROOM:
                    before, step = step.split(n - 1)
                    out.append(before)
                    at += n - 1
                    held, n = size, 1
        out.append(step)
        at += len(step.terms)
    return tuple(out)
