"""Coefficients as the evaluator's words: how many bits of what, so that it is quick and accurate.

`choose` tries forms from the quickest on and takes the first whose error against float64, over vectors of the
domain, is well within the limits. Fractions count binary places; inputs lie within +-1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from palpate.fixedpoint.errors import ProofError
from palpate.fixedpoint.form import (
    JUDGED,
    ROUNDED,
    Form,
    Inputs,
    least_down,
    predicted,
    with_room,
)
from palpate.fixedpoint.nested import SIGMA, Run, Step
from palpate.fixedpoint.rounding import Rounding
from palpate.fixedpoint.word_pairs import (
    ROOM,
    Floats,
    Integers,
    Row,
    Words,
    places_within,
    split,
    to_word,
)

GOOD_MEDIAN, GOOD_WORST = 3e-6, 2.4e-5
# bits of an input that high words meet, bits that low words meet, bits of a low word: long low words leave
# fewer coefficients with a high one, and more runs must be cut; the models here are quickest so
SPLITS = ((20, 14, 14), (21, 14, 14), (22, 15, 14), (21, 15, 13), (22, 15, 12), (20, 15, 12), (18, 15, 11))
WIDTH_ERROR = 2e-5  # of half an interval, on the link scale
MOST_DOWN = 15
COARSEST, FINEST = 13, 24  # places of a coefficient
FARTHEST_MOVED = 16  # of its last place


class _Output:
    """Output j's row: what it is exactly, and how far from that its words are."""

    def __init__(self, j: int, row: Row, inputs: Inputs, floor: float | Floats) -> None:
        self.j = j
        self.row = row
        self.inputs = inputs
        self.exact = inputs.terms[:, :-1] @ row.coefficients + row.intercept
        if isinstance(floor, np.ndarray):
            self.sizes = floor
        else:
            self.sizes = np.maximum(np.abs(self.exact), floor) if floor else np.ones_like(self.exact)
        self.rounding = inputs.rounding(self.sizes)
        self._rounded: dict[int, Integers] = {}

    def rounded(self, places: int) -> Integers:
        """Coefficients in whole numbers of 2^-places."""
        if places not in self._rounded:
            whole = self.rounding.whole(np.append(self.row.coefficients, 0.0), places)
            self._rounded[places] = whole[:-1].astype(np.int64)
        return self._rounded[places]

    def words(self, places: int, form: Form, whole: Integers | None = None) -> Words:
        """The row's words in a form; what is rounded down on the way is compensated in the intercept."""
        row = self.row
        fraction = places - form.low
        shift = fraction + form.part - form.downs[self.j] - row.fraction
        words = Words(*split(self.rounded(places) if whole is None else whole, form.low), 0, shift, fraction)
        less = self.exact - predicted(words, form, self.j, self.inputs)
        weights = self.sizes[ROUNDED] ** -2
        intercept = (less[ROUNDED] * weights).sum() / weights.sum()
        return replace(
            words, intercept=to_word(intercept * 2.0**row.fraction, f"the intercept of {row.name}")
        )

    def fewer(self, places: int, form: Form) -> Words:
        """The same without words that hardly matter: a coefficient moves a little where that makes one 0."""
        whole, half = self.rounded(places), 1 << form.low - 1
        cheap = np.stack(
            [np.zeros_like(whole), np.clip(whole, -half, half - 1), split(whole, form.low)[0] << form.low]
        )
        away = np.where(cheap == whole, FARTHEST_MOVED + 1, np.abs(cheap - whole))
        words = self.words(places, form)
        for at in np.argsort(away.min(axis=0)):
            if away[:, at].min() > FARTHEST_MOVED:
                break
            tried = whole.copy()
            tried[at] = cheap[np.argmin(away[:, at]), at]
            moved = self.words(places, form, tried)
            if self.badness(moved, form) < 1:
                whole, words = tried, moved
        return words

    def down(self, part: int, low: int, places: int) -> int:
        """What its runs must be shifted down by."""
        return least_down(self.inputs.steps, self.row, part + places - low)

    def badness(self, words: Words, form: Form) -> float:
        """Errors over what is good: below 1 is good."""
        errors = (np.abs(predicted(words, form, self.j, self.inputs) - self.exact) / self.sizes)[JUDGED]
        return float(max(np.median(errors) / GOOD_MEDIAN, errors.max() / GOOD_WORST))

    def coarsest(self, part: int, high: int, low: int) -> tuple[float, int] | None:
        """The least places that are good, else the best; None if there is no room for any."""
        best = None
        for places in range(COARSEST, FINEST + 1):
            down = self.down(part, low, places)
            form = Form(part, high, low, (down,) * (self.j + 1), tuple(self.inputs.steps))
            if not 0 <= down <= min(part - low, MOST_DOWN):
                break
            words = self.words(places, form)
            if np.abs(words.high).max() * 1.001 * 2.0**part >= ROOM:
                break
            bad = self.badness(words, form)
            if best is None or bad < best[0]:
                best = bad, places
            if bad < 1:
                break
        return best


def choose(
    rows: list[Row], inputs: Inputs, floors: Sequence[float | Floats], fewer: bool = False
) -> tuple[Form, list[Words]]:
    """The quickest form of the outputs' rows that is accurate, or else the most accurate.

    Half of the vectors serve to round by, the other half to judge.

    Parameters
    ----------
    rows : list of Row
        Of the outputs.
    inputs : Inputs
        At some vectors of the domain.
    floors : list of float, or of array (n,)
        For each output: errors count relative to the value or this, whichever is larger; 0: a logarithm,
        whose errors are relative as they are; an array: relative to its entries.
    fewer : bool
        Leave out words that hardly matter: it takes longer.

    Raises
    ------
    ProofError
        If no form has room for the coefficients.
    """
    outputs = [_Output(j, row, inputs, floor) for j, (row, floor) in enumerate(zip(rows, floors))]
    best: tuple[float, Form, list[Words]] | None = None
    for part, high, low in SPLITS:
        given = [output.coarsest(part, high, low) for output in outputs]
        if None in given:
            continue
        places = [p[1] for p in given if p is not None]
        downs = tuple(output.down(part, low, n) for output, n in zip(outputs, places))
        form = Form(part, high, low, downs, tuple(inputs.steps))
        steps = with_room(form, [output.words(n, form) for output, n in zip(outputs, places)], form.steps)
        if steps is not None:
            form = replace(form, steps=steps)
            bad = max(p[0] for p in given if p is not None)
            if best is None or bad < best[0]:
                best = bad, form, [output.words(n, form) for output, n in zip(outputs, places)]
            if bad < 1:
                break
    if best is None:
        row = max(rows, key=lambda r: float(np.abs(r.coefficients).sum()))
        raise ProofError(f"the coefficients of {row.name} are too large for the firmware's integers")
    if fewer and best[0] < 1:
        places = [w.fraction + best[1].low for w in best[2]]
        return best[1], [output.fewer(n, best[1]) for output, n in zip(outputs, places)]
    return best[1], best[2]


def choose_few(
    rows: list[Row], form: Form, inputs: Floats, widths: Floats
) -> tuple[list[Words], tuple[Step, ...], int]:
    """Rows of ln sigma in the outputs' form: words, runs, and what each run is shifted down by.

    Parameters
    ----------
    rows : list of Row
    form : Form
    inputs : array (n, k)
        The sums' inputs, within +-1, at some vectors of the domain.
    widths : array (n, rows)
        Half the interval there, on the link scale: what an error of ln sigma is multiplied with.

    Raises
    ------
    ProofError
        If there is no room for the coefficients.
    """
    given = []
    for row, width in zip(rows, widths.T):
        places = places_within(row, form.part, form.high, form.low, WIDTH_ERROR / max(width.max(), 1e-9))
        weight = width if width.any() else np.ones(len(width))  # an output may have no interval
        rounding = Rounding(
            np.c_[inputs, np.ones(len(inputs))] * weight[:, None], np.arange(inputs.shape[1] + 1)
        )
        rounded = rounding.whole(np.append(row.coefficients, 0.0), places)
        given.append((rounded[:-1].astype(np.int64), places, row.intercept + rounded[-1] * 2.0**-places))
    sizes = [float(np.abs(whole).sum()) * 2.0 ** (form.part - form.low) for whole, _, _ in given]
    down = max(int(np.ceil(np.log2(max(*sizes, 1.0) / ROOM))), 0)
    words = []
    for row, (whole, places, intercept) in zip(rows, given):
        value = to_word(intercept * 2.0**row.fraction, f"the intercept of {row.name}")
        fraction = places - form.low
        shift = fraction + form.part - down - row.fraction
        words.append(Words(*split(whole, form.low), value, shift, fraction))
    runs = with_room(form, words, [Run(SIGMA, tuple(range(inputs.shape[1])))])
    if runs is None or down > MOST_DOWN:
        raise ProofError("the coefficients of ln sigma are too large for the firmware's integers")
    return words, runs, down
