"""Before and after, on lumps that the adaptation has not seen."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from palpate.adaptation.adapt import FEWEST_LUMPS, adapt_to
from palpate.dataset.agreement import errors_of
from palpate.dataset.answers import NAMES, OUTPUTS, JudgedAnswers, answers
from palpate.dataset.strokes import ObservedDataSet
from palpate.model_export.schema import ModelSpec
from palpate.progress import ProgressCallback

FOLDS = 10
_FEWEST_LEFT = 3
_PARTS = "value", "low", "high"


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
        for name in NAMES:
            if (name, "after") in self.numbers:
                pair = [self.numbers[name, side] for side in ("before", "after")]
                shares = [(side[k], 0 if k == 2 else 1) for k in range(3) for side in pair]
                rows.append([name, *(f"{100 * share:z.{digits}f} %" for share, digits in shares)])
        return heads, rows, f"{self.lumps} lumps, each left out once"


def before_and_after(
    spec: ModelSpec, seen: ObservedDataSet, progress: ProgressCallback | None = None
) -> Compared:
    """Adapt without some lumps and judge by these, in turns (`FOLDS`, or each lump alone)."""
    before = answers(spec, seen)
    lumps = np.unique(before.group[before.lump])
    folds = min(FOLDS, len(lumps))
    fewest = max(FEWEST_LUMPS - -(-len(lumps) // folds), _FEWEST_LEFT)  # of five lumps the other four
    after = replace(before, **{part: getattr(before, part).copy() for part in _PARTS})
    fold_of = {lump: k % folds for k, lump in enumerate(lumps)}
    fold = np.array([fold_of.get(lump, -1) for lump in before.group])
    for k in range(folds):
        said = answers(adapt_to(spec, seen.take(fold != k), fewest).spec, seen)
        for part in _PARTS:
            getattr(after, part)[fold == k] = getattr(said, part)[fold == k]
        if progress is not None:
            progress("lumps left out", k + 1, folds)
    numbers = {
        (name, side): _numbers(said, name)
        for name in OUTPUTS
        for side, said in (("before", before), ("after", after))
        if before.known(name).any()
    }
    return Compared(numbers, len(lumps))


def _numbers(said: JudgedAnswers, name: str) -> tuple[float, float, float]:
    used, j = said.known(name), OUTPUTS.index(name)
    error = errors_of(name, said.value[used, j], said.truth[used, j])
    return float(error.mean()), float(np.median(np.abs(error))), float(said.covered[used, j].mean())
