"""What a model says of a data set's strokes, beside the truth. Units: mm, N per metre; E^-2/3 has none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firmware_py import outputs, status
from palpate.dataset.checks import fault, slip_of
from palpate.dataset.strokes import ObservedDataSet
from palpate.dataset.table import DataSet
from palpate.features.map_features import Floats
from palpate.learn import probe_model
from palpate.learn.observed import NAMES as FEATURES
from palpate.model_export.integers.reference import evaluate, inputs
from palpate.model_export.schema import ModelSpec
from palpate.model_export.vocabulary import WORDS
from palpate.spans import Span, depth_mm

DEPTH = "depth_mm"
OUTPUTS = tuple(dict.fromkeys((*outputs.NAMES, DEPTH)))
"""The model's outputs, and the depth that follows from them."""

NAMES = {
    "d_mm": "diameter",
    "depth_mm": "depth",
    "h": "depth in diameters",
    "t_mm": "fat's thickness",
    "E_inv23": "stiffness, E^-2/3",
    "F_N_per_m": "force",
}
NAMES |= {name: words for name, words in WORDS.items() if name not in NAMES}
"""Outputs in the order and the words of reports."""

TRUTH_COLUMN = {"E_inv23": "E_ratio"}
"""Output -> the data set's column, where they are called differently."""


@dataclass(frozen=True)
class JudgedAnswers:
    """A model's answers for n strokes beside the truth; columns by `OUTPUTS`.

    Attributes
    ----------
    value, low, high, truth : (n, outputs)
        NaN in the truth where the data set does not say.
    lump : (n), bool
        Whether a lump was found.
    in_domain, force_out : (n), bool
    hardness : (n), str
        hard, soft, unsure.
    group : (n), int
        Which lump.
    hard : (n), bool
        Truly so; meaningless where the truth of E_inv23 is NaN.
    level : float
        The intervals' coverage as the model states it.
    """

    value: Floats
    low: Floats
    high: Floats
    truth: Floats
    lump: NDArray[np.bool_]
    in_domain: NDArray[np.bool_]
    force_out: NDArray[np.bool_]
    hardness: NDArray[np.str_]
    group: NDArray[np.int64]
    hard: NDArray[np.bool_]
    level: float

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Strokes over a lump that the model knows, (n)."""
        return self.lump & self.in_domain

    def known(self, name: str) -> NDArray[np.bool_]:
        """Strokes in which a lump was found and that have a truth of this output, (n)."""
        return self.lump & ~np.isnan(self.truth[:, OUTPUTS.index(name)])

    @property
    def covered(self) -> Floats:
        """1 where the interval holds the truth, 0 where it does not, NaN where there is none."""
        inside = (self.low - 1e-12 <= self.truth) & (self.truth <= self.high + 1e-12)
        return np.where(np.isnan(self.truth), np.nan, inside)


def found(spec: ModelSpec, X: Floats, codes: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether the strokes are whole by the pipeline's status (n) and show a lump."""
    return np.isin(codes, (status.OK, status.NO_FIT)) & shows_lump(spec, X)


def shows_lump(spec: ModelSpec, X: Floats) -> NDArray[np.bool_]:
    """The model's lump rule on features (n, all)."""
    return probe_model.shows_lump(X, FEATURES, spec.lump)


def truth_of(seen: ObservedDataSet) -> Floats:
    """The truth of every stroke, (n, outputs), in the order of `OUTPUTS`; NaN where it is not known."""
    out = np.full((len(seen), len(OUTPUTS)), np.nan)
    for j, name in enumerate(OUTPUTS):
        column = TRUTH_COLUMN.get(name, name)
        if column in seen.table:
            values = seen.table[column].to_numpy(float)
            out[:, j] = values ** (-2 / 3) if name == "E_inv23" else values
    return out


def answers(spec: ModelSpec, seen: ObservedDataSet) -> JudgedAnswers:
    """The model's answers, in float64 as the probe's integers give them to a part in a thousand or better."""
    said = evaluate(spec, inputs(spec, seen.X))
    value, low, high = (with_depth(said, part) for part in ("value", "low", "high"))
    truth = truth_of(seen)
    return JudgedAnswers(
        value,
        low,
        high,
        truth,
        found(spec, seen.X, seen.status),
        said["in_domain"],
        said["force_out"],
        said["hardness"],
        seen.lump,
        truth[:, outputs.E_INV23] <= probe_model.HARD_BELOW + 1e-12,
        spec.interval.level,
    )


def with_depth(said: dict[str, Floats], part: str) -> Floats:
    """An answer's values, lows or highs, (n, outputs), with those of the depth behind them."""
    if DEPTH in outputs.NAMES:
        return said[part]
    at = ("value", "low", "high").index(part)
    t, d, h = (outputs.NAMES.index(name) for name in ("t_mm", "d_mm", "h"))
    depth = [depth_mm(*(_span(said, k, j) for j in (t, d, h)))[at] for k in range(len(said["value"]))]
    return np.column_stack([said[part], depth])


def _span(said: dict[str, Floats], k: int, j: int) -> Span:
    return float(said["value"][k, j]), float(said["low"][k, j]), float(said["high"][k, j])


def check_ranges(data: DataSet, spec: ModelSpec) -> NDArray[np.bool_]:
    """Rows whose truth lies within the model's ranges, (n), bool; see `refuse_outside`."""
    return np.array([_outside(line, spec) == ("", "") for _, line in data.table.iterrows()], bool)


def refuse_outside(data: DataSet, spec: ModelSpec) -> None:
    """`DataSetError` for the first truth outside the model's range, with row and column."""
    for _, line in data.table.iterrows():
        column, what = _outside(line, spec)
        if column:
            raise fault(line["row"], column, what)


def _outside(line: object, spec: ModelSpec) -> tuple[str, str]:
    ranges = sorted(zip(spec.outputs, spec.domain.ranges), key=lambda pair: pair[0].name == "t_mm")
    for output, (low, high) in ranges:  # t last: it is mostly worked out, and another column is to blame
        low, high = (output.lo if low is None else low), (output.hi if high is None else high)
        column = TRUTH_COLUMN.get(output.name, output.name)
        if column == "E_ratio":
            low, high = (end**-1.5 if end > 0 else np.inf for end in (high, max(low, 0.0)))
        value = float(line[column]) if column in line else np.nan  # type: ignore[index,operator]
        if value == value and not low * (1 - 1e-6) <= value <= high * (1 + 1e-6):
            slip = slip_of(column, value, low, high)
            hint = slip or "; leave such lumps out with --leave-out"
            return column, f"{value:.3g} is outside the model's range of {low:.3g} to {high:.3g}{hint}"
    return "", ""
