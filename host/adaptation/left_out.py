"""Before and after, on lumps that the adaptation has not seen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.adaptation.adapt import FEWEST_LUMPS, adapt_to
from palpate.dataset.agreement import errors_of
from palpate.dataset.answers import OUTPUTS, JudgedAnswers, answers
from palpate.dataset.strokes import ObservedDataSet
from palpate.model_export.schema import ModelSpec

FOLDS = 10
_FEWEST_LEFT = 3
SHOWN = tuple(dict.fromkeys(("d_mm", "depth_mm", "h", "t_mm", "E_inv23", "F_N_per_m", *OUTPUTS)))


@dataclass(frozen=True)
class Compared:
    """Bias, median error and coverage by output, of the model before and after, on left-out lumps.

    Attributes
    ----------
    numbers : dict
        (output, "before" or "after") -> (bias, median error, coverage).
    lumps : int
        That were left out in turn.
    """

    numbers: dict[tuple[str, str], tuple[float, float, float]]
    lumps: int

    def of(self, name: str) -> dict[str, Any]:
        """One output's, for JSON."""
        words = ("bias", "median_error", "coverage")
        sides = ("before", "after")
        return {s: dict(zip(words, self.numbers[name, s])) for s in sides if (name, s) in self.numbers}

    def as_table(self) -> tuple[list[str], list[list[str]], str]:
        """Heads, rows and title, for people."""
        heads = [
            "left-out lumps",
            *(f"{w} {s}" for w in ("bias", "error", "covered") for s in ("before", "after")),
        ]
        rows = []
        for name in SHOWN:
            if (name, "after") in self.numbers:
                pair = [self.numbers[name, side] for side in ("before", "after")]
                shares = [(side[k], 0 if k == 2 else 1) for k in range(3) for side in pair]
                rows.append([name, *(f"{100 * share:z.{digits}f} %" for share, digits in shares)])
        return heads, rows, f"{self.lumps} lumps, each left out once"


def before_and_after(
    spec: ModelSpec, seen: ObservedDataSet, progress: Callable[[str, int, int], None] | None = None
) -> Compared:
    """Adapt without some lumps and judge by these, in turns (`FOLDS`, or each lump alone)."""
    before = answers(spec, seen)
    lumps = np.unique(before.group[before.lump])
    folds = min(FOLDS, len(lumps))
    fewest = max(FEWEST_LUMPS - -(-len(lumps) // folds), _FEWEST_LEFT)  # of five lumps the other four
    after = {word: np.array(getattr(before, word)) for word in ("value", "low", "high")}
    fold_of = {lump: k % folds for k, lump in enumerate(lumps)}
    fold = np.array([fold_of.get(lump, -1) for lump in before.group])
    for k in range(folds):
        said = answers(adapt_to(spec, seen.take(fold != k), fewest).spec, seen)
        for word, values in after.items():
            values[fold == k] = getattr(said, word)[fold == k]
        if progress is not None:
            progress("lumps left out", k + 1, folds)
    numbers = {}
    for j, name in enumerate(OUTPUTS):
        used = before.lump & ~np.isnan(before.truth[:, j])
        if not used.any():
            continue
        numbers[name, "before"] = _numbers(before, before.value, before.low, before.high, used, j)
        numbers[name, "after"] = _numbers(before, after["value"], after["low"], after["high"], used, j)
    return Compared(numbers, len(lumps))


def _numbers(
    said: JudgedAnswers, value: np.ndarray, low: np.ndarray, high: np.ndarray, used: np.ndarray, j: int
) -> tuple[float, float, float]:
    truth = said.truth[used, j]
    error = errors_of(OUTPUTS[j], value[used, j], truth)
    inside = (low[used, j] <= truth) & (truth <= high[used, j])
    return float(error.mean()), float(np.median(np.abs(error))), float(inside.mean())
