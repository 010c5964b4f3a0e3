"""The answer of a visit: strokes over one lump pooled into one estimate with its interval.

What differs from stroke to stroke averages out; what the model does not know of the lump is in every stroke
alike, and does not. A stroke's interval holds both, and the scatter between strokes tells the first.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from firmware_py.outputs import PARTS
from palpate.answer import words
from palpate.answer.card import ROWS, verdict
from palpate.answer.fitted import HARD
from palpate.spans import Span, stiffness

if TYPE_CHECKING:
    from palpate.answer.told import Told
    from palpate.wire.events import Estimate

HOW = (
    "Strokes pooled by random effects (Paule and Mandel, Hartung and Knapp; statsmodels). What differs from "
    "stroke to stroke averages out. What the strokes share stays in the interval: at least half of the "
    "variance of one."
)
"""Said wherever a pooled estimate is."""
LEAST_COMMON = 0.5
"""Of one stroke's variance: taken to be common to all strokes over a lump even where these scatter as much as
their intervals allow, for intervals are made for many lumps and not for this one."""
POOLS_WITH = "statsmodels.stats.meta_analysis"
"""Imported when it is first needed, for it takes seconds."""
_OF_A_STROKE = ("place_mm", "F_N_per_m")
"""What is no lump's: each stroke has a line and a hand of its own."""
_STIFFNESS = "E_inv23"


@dataclass(frozen=True)
class VisitAnswer:
    """What the strokes over one lump say together.

    Attributes
    ----------
    strokes : int
        Pooled; `left_out` more are not vouched for, or another model's.
    level : float
        Coverage that the intervals are meant to have.
    spans : mapping
        Value, low and high of the lump by the keys and in the units of the card's rows, and of `E_inv23`.
    """

    strokes: int
    left_out: int
    level: float
    spans: Mapping[str, Span]

    @property
    def hardness(self) -> str:
        """hard, soft, or unsure; "" where the model tells no stiffness."""
        if _STIFFNESS not in self.spans:
            return ""
        _, low, high = self.spans[_STIFFNESS]
        return "hard" if high <= HARD else "soft" if low >= HARD else "unsure"

    def stiffness_words(self, fat_kPa: float | None = None) -> str:
        """Value and interval as a factor, in kPa too where the fat is known; "" without a stiffness."""
        if _STIFFNESS not in self.spans:
            return ""
        fat = self.spans.get("E_fat_kPa") if fat_kPa is None else (fat_kPa, fat_kPa, fat_kPa)
        return words.stiffness_words(self.spans[_STIFFNESS], fat)

    def as_dict(self) -> dict[str, Any]:
        """As `--json` prints it, and the page gets it."""
        spans = {key: dict(zip(PARTS, span)) for key, span in self.spans.items()}
        out: dict[str, Any] = {
            "strokes": self.strokes,
            "left_out": self.left_out,
            "level": self.level,
            **spans,
        }
        if _STIFFNESS in self.spans:
            out["E_ratio"] = dict(zip(PARTS, stiffness(self.spans[_STIFFNESS])))
            out["hardness"] = self.hardness
        return {**out, "how": HOW}


def visit_answer(answers: Sequence[tuple[Estimate | None, Told | None]]) -> VisitAnswer | None:
    """Pool strokes over one lump; None of fewer than two that the card vouches for.

    Parameters
    ----------
    answers : sequence of (Estimate or None, Told or None)
        Of every stroke, oldest first. The model of the last one that is vouched for counts.
    """
    sure = [(e, told) for e, told in answers if e is not None and verdict(e) == "lump"]
    sure = [(e, told) for e, told in sure if e.model_id == sure[-1][0].model_id]
    if len(sure) < 2:
        return None
    level = sure[-1][0].level_permille / 1000
    found: dict[str, list[Span | None]] = {
        row.key: [row.of(e, told) for e, told in sure] for row in ROWS if row.key not in _OF_A_STROKE
    }
    found[_STIFFNESS] = [e.span(_STIFFNESS) if _STIFFNESS in e.outputs else None for e, _ in sure]
    spans = {key: pool([s for s in of if s], level) for key, of in found.items() if of and None not in of}
    return VisitAnswer(len(sure), len(answers) - len(sure), level, spans)


def pool(spans: Sequence[Span], level: float) -> Span:
    """One value with its interval from those of several strokes over one lump.

    Where all are positive they are pooled as logarithms. The variance of one stroke (its interval's, and what
    the strokes scatter beyond) less that between strokes, but at least `LEAST_COMMON` of it, is common to
    all; the sum of that and of the variance of the mean makes the interval, with Student's t and
    Satterthwaite's degrees of freedom. It is no wider than that of one stroke.

    Parameters
    ----------
    spans : value, low and high of each stroke
    level : coverage of these intervals, and of the result's

    Examples
    --------
    >>> pool([(10.0, 9.0, 11.0), (10.4, 9.4, 11.4), (9.9, 8.9, 10.9)], 0.9)[0]
    10.09...
    """
    from scipy import stats
    from statsmodels.stats.meta_analysis import combine_effects

    value, low, high = np.array(spans, dtype=np.float64).T
    if np.all(low >= high):  # told, not measured
        return float(np.median(value)), float(np.median(value)), float(np.median(value))
    positive = bool(np.all(low > 0))
    there, back = (np.log, np.exp) if positive else (np.asarray, np.asarray)
    y, below, above = there(value), there(low), there(high)
    one = stats.norm.ppf(0.5 + level / 2)
    variance = np.maximum(((above - below) / (2 * one)) ** 2, 1e-12)
    n = len(y)
    if n == 1:
        return spans[0]
    with np.errstate(all="ignore"):  # of strokes that agree wholly it divides by their scatter
        found = combine_effects(y, variance, method_re="iterated")
    of_mean = found.sd_eff_w_re_hksj**2
    of_one = float(np.mean(variance)) + found.tau2
    common = max(LEAST_COMMON * of_one, of_one - n * of_mean)
    freedom = (common + of_mean) ** 2 * (n - 1) / max(of_mean**2, 1e-24)
    half = min(stats.t.ppf(0.5 + level / 2, freedom) * np.sqrt(common + of_mean), one * np.sqrt(of_one))
    lean = float(np.sum(above - y) / np.sum(above - below))  # a model's intervals need not be even
    middle = found.mean_effect_re
    low_1, high_1 = middle - 2 * (1 - lean) * half, middle + 2 * lean * half
    return float(back(middle)), float(back(low_1)), float(back(high_1))
