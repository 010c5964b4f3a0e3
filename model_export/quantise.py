"""Coefficients as the evaluator's words: how many bits, in which groups, and what that costs in accuracy.

`choose` tries forms from the quickest on and takes the first whose error against float64, over vectors of the
domain, is well within the limits. Fractions count binary places; inputs lie within +-1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model_export.errors import ProofError

HIGH_BITS = 13  # of an input, the part that low words meet
ROOM = 1.06e9  # below 2^30: the proof's intervals are a little wider than the sums here
GOOD_MEDIAN, GOOD_WORST = 3e-6, 3.6e-5  # the promise is 5e-6 and 5e-5
# Bits of an input in a model that is not fine, and fractions of its high words; low bits of either kind.
PARTS, FRACTIONS, LOW = (20, 19, 18), range(5, 12), 12
SPREAD = 2  # how much finer than the rest a row of small coefficients may be
FINE_LOW, FINE_FRACTIONS = (8, 10, 12), (None, 8, 10, 12)
MOST = 32000  # of a high word
MOST_SIGMA, MOST_COARSE = 8191, 2000

Integers = NDArray[np.int64]
Floats = NDArray[np.float64]


@dataclass
class Row:
    """One sum: coefficients over its inputs (each within +-1), intercept, fraction bits of the result."""

    coefficients: Floats
    intercept: float
    fraction: int
    name: str


@dataclass(frozen=True)
class Form:
    """What all sums of a model share.

    Attributes
    ----------
    part : int
        Bits of an input in the first product.
    low : int
        Bits of a low word.
    fine : bool
        Whether the input's next bits count, too.
    group_shift : int
        What each group's sum of the outputs is shifted down by.
    ends : tuple of int
        For each group of terms the term after its last.
    """

    part: int
    low: int
    fine: bool
    group_shift: int
    ends: tuple[int, ...]

    @property
    def cut(self) -> int:
        """What takes the sum of the lesser products to the scale of the first."""
        return self.low + HIGH_BITS - self.part

    @property
    def groups(self) -> list[tuple[int, int]]:
        """First term of each group, and the one after its last."""
        return list(pairwise((0, *self.ends)))


@dataclass(frozen=True)
class Words:
    """A row in integers: high and low words, intercept, shift of its sum, fraction bits of the high words."""

    high: Integers
    low: Integers
    intercept: int
    shift: int
    fraction: int


def to_word(value: float, name: str) -> int:
    """Nearest integer; ProofError if it is beyond the firmware's integers."""
    number = round(value)
    if abs(number) >= 1 << 30:
        raise ProofError(f"{name} does not fit the firmware's integers: {value:g} is beyond 2^30")
    return number


def coarse(row: Row) -> Words:
    """A row of high words alone, for inputs of HIGH_BITS."""
    fraction = _finest(row, HIGH_BITS, [(0, len(row.coefficients))], MOST_COARSE)
    high = np.round(row.coefficients * 2.0**fraction).astype(np.int64)
    intercept = to_word(row.intercept * 2.0**row.fraction, f"the intercept of {row.name}")
    return Words(high, np.zeros_like(high), intercept, fraction + HIGH_BITS - row.fraction, fraction)


def quantise(row: Row, form: Form, fraction: int, groups: list[tuple[int, int]], group_shift: int) -> Words:
    """A row in the words of a form; what is rounded down on the way is made good in the intercept."""
    whole = np.round(row.coefficients * 2.0 ** (fraction + form.low)).astype(np.int64)
    high = (whole + (1 << form.low - 1)) >> form.low
    low = whole - (high << form.low)
    bits = HIGH_BITS + form.low if form.fine else form.part
    unit = 2.0 ** -(fraction + form.part - group_shift)
    lost = row.coefficients.sum() * 2.0**-bits + low.sum() * 2.0 ** -(fraction + form.low + HIGH_BITS)
    lost += len(groups) * unit
    intercept = to_word((row.intercept + lost / 2) * 2.0**row.fraction, f"the intercept of {row.name}")
    return Words(high, low, intercept, fraction + form.part - group_shift - row.fraction, fraction)


def single(row: Row, form: Form) -> Words:
    """A row whose inputs are one group, at the finest scale that cannot overflow."""
    groups = [(0, len(row.coefficients))]
    for fraction in range(_finest(row, form.part, groups, MOST_SIGMA), -30, -1):
        words = quantise(row, form, fraction, groups, 0)
        if _small(words, form, groups):
            return words
    raise ProofError(f"the coefficients of {row.name} are too large for the firmware's integers")


def _finest(row: Row, part: int, groups: list[tuple[int, int]], most: int) -> int:
    """Fraction bits of a row's high words: as many as its groups have room for."""
    sizes = np.abs(row.coefficients)
    top = 1.001 * 2.0**part
    for fraction in range(24, -30, -1):
        scaled = sizes * 2.0**fraction
        if np.max(scaled, initial=0.0) <= most and all(
            (scaled[a:b].sum() + b - a) * top < ROOM for a, b in groups
        ):
            return fraction
    raise ProofError(f"the coefficients of {row.name} are too large for the firmware's integers")


def _small(words: Words, form: Form, groups: list[tuple[int, int]]) -> bool:
    """Do the sums of the lesser products stay small in each group?"""
    sizes = np.abs(words.low) * 8200.0
    if form.fine:
        sizes = sizes + np.abs(words.high) * 2.0**form.low
    return all(sizes[a:b].sum() < ROOM for a, b in groups)


def _group(rows: list[Row], part: int, fraction: int) -> tuple[int, ...] | None:
    """Ends of the longest groups of terms in which no row's sum can overflow; None if a term alone would."""
    sizes = (np.abs([row.coefficients for row in rows]) * 2.0**fraction + 1) * 1.001 * 2.0**part
    most_terms = int(ROOM / (2 ** (LOW - 2) * 1.25 * 8200))
    ends: list[int] = []
    first = 0
    held = np.zeros(len(rows))
    for k, more in enumerate(sizes.T):
        if more.max() >= ROOM or np.max(sizes[:, k]) / (1.001 * 2.0**part) > MOST:
            return None
        if (held + more).max() >= ROOM or k - first == most_terms:
            ends.append(k)
            first, held = k, np.zeros(len(rows))
        held = held + more
    return (*ends, sizes.shape[1])


def _group_shift(rows: list[Row], part: int, fractions: list[int], n_groups: int) -> int:
    """The least shift with which the groups' sums together stay small."""
    if n_groups == 1:
        return 0
    size = max(
        (np.abs(row.coefficients).sum() * 2.0**f + len(row.coefficients)) * 1.001 * 2.0**part
        for row, f in zip(rows, fractions)
    )
    return max(int(np.ceil(np.log2(size / ROOM))), 0)


def _forms(rows: list[Row]) -> list[tuple[Form, list[Words]]]:
    """All forms that the outputs' rows have room for, the quickest first."""
    found = []
    for part in PARTS:
        for fraction in FRACTIONS:
            ends = _group(rows, part, fraction)
            if ends is not None:
                groups = list(pairwise((0, *ends)))
                fractions = [min(_finest(row, part, groups, MOST), fraction + SPREAD) for row in rows]
                shift = _group_shift(rows, part, fractions, len(ends))
                found.append((Form(part, LOW, False, shift, ends), fractions))
    for low in FINE_LOW:
        for wanted in FINE_FRACTIONS:
            ends = (len(rows[0].coefficients),) if wanted is None else _group(rows, HIGH_BITS, wanted)
            if ends is not None:
                groups = list(pairwise((0, *ends)))
                try:
                    fractions = [_finest(row, HIGH_BITS, groups, MOST) for row in rows]
                except ProofError:
                    continue
                shift = _group_shift(rows, HIGH_BITS, fractions, len(ends))
                found.append((Form(HIGH_BITS, low, True, shift, ends), fractions))
    out = []
    for form, fractions in sorted(found, key=lambda item: (_cost(item[0]), -item[0].part)):
        words = [quantise(r, form, f, form.groups, form.group_shift) for r, f in zip(rows, fractions)]
        if all(_small(w, form, form.groups) for w in words):
            out.append((form, words))
    return out


def _cost(form: Form) -> int:
    """Operations that an interpreter takes for a row, about."""
    return form.ends[-1] * (12 if form.fine else 8) + 14 * len(form.ends)


class Inputs:
    """The terms at n vectors, in float64 and as the evaluator has them.

    Parameters
    ----------
    features : array (n, features)
        Within +-1.
    steps : bytes
        For each product the term and the feature that it is the product of.
    """

    def __init__(self, features: Floats, steps: bytes) -> None:
        self.steps = list(zip(steps[::2], steps[1::2]))
        self.terms = self._products(features, lambda a, b: a * b)
        self.whole = np.floor(features * 2.0**28).astype(np.int64)

    def _products(self, features: Any, multiply: Callable[[Any, Any], Any]) -> Any:
        columns = list(features.T)
        for term, feature in self.steps:
            columns.append(multiply(columns[term], columns[feature]))
        return np.array(columns).T

    def words(self, form: Form) -> tuple[Integers, Integers, Integers]:
        """part, high and rest (n, terms) in this form."""
        if form.fine:
            u = self._products(self.whole, lambda a, b: a * b >> 28)
            return u >> 15, u >> 15, (u >> 15 - form.low) & (1 << form.low) - 1
        part = self._products(self.whole >> 28 - form.part, lambda a, b: a * b >> form.part)
        high = part >> form.part - HIGH_BITS
        return part, high, np.zeros_like(high)


def predicted(words: Words, form: Form, inputs: tuple[Integers, Integers, Integers]) -> Floats:
    """What the evaluator makes of a row of Q24 for such inputs, on the link scale."""
    part, high, rest = inputs
    total = np.zeros(len(part), np.int64)
    lesser = high * words.low + rest * words.high
    first = part * words.high
    for a, b in form.groups:
        total += (first[:, a:b].sum(1) + (lesser[:, a:b].sum(1) >> form.cut)) >> form.group_shift
    return np.asarray((total * 2.0**-words.shift + words.intercept) / 2.0**24)


def choose(rows: list[Row], inputs: Inputs, floors: list[float]) -> tuple[Form, list[Words]]:
    """The quickest form of the outputs' rows that is accurate, or else the most accurate.

    Parameters
    ----------
    rows : list of Row
        Of the outputs.
    inputs : Inputs
        At some vectors of the domain.
    floors : list of float
        For each output: errors count relative to the value or this, whichever is larger; 0: a logarithm,
        whose errors are relative as they are.

    Raises
    ------
    ProofError
        If no form has room for the coefficients.
    """
    best: tuple[float, Form, list[Words]] | None = None
    exact = [inputs.terms @ row.coefficients + row.intercept for row in rows]
    sizes = [np.maximum(np.abs(y), floor) if floor else np.ones_like(y) for y, floor in zip(exact, floors)]
    for form, words in _forms(rows):
        given = inputs.words(form)
        errors = np.array(
            [np.abs(predicted(w, form, given) - y) / size for w, y, size in zip(words, exact, sizes)]
        )
        badness = max(np.median(errors, axis=1).max() / GOOD_MEDIAN, errors.max() / GOOD_WORST)
        if badness < 1:
            return form, words
        if best is None or badness < best[0]:
            best = badness, form, words
    if best is None:
        row = max(rows, key=lambda r: float(np.abs(r.coefficients).sum()))
        raise ProofError(f"the coefficients of {row.name} are too large for the firmware's integers")
    return best[1], best[2]
