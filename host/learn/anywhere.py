"""Lumps anywhere, each predicted without itself: by place, where they are said to lie, what is known of size
where stiffness is not."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from palpate.answer.layers import (
    BORDER,
    FAT,
    GLAND,
    PLACES,
    UNSURE,
    half_widths,
    layer_of,
    odds,
    said,
    values,
)
from palpate.features.map_features import Floats
from palpate.learn.conformal import LEVEL, fit_sigma, quantile_of_part
from palpate.learn.model import FittedModel
from palpate.learn.observed import Observed
from palpate.learn.probe_model import E_INV23, HARD_BELOW, OUTPUTS, floats, standardised
from palpate.learn.scopes import ANYWHERE, Parts, Scope, by_place, true_place
from palpate.learn.score import of_output
from palpate.learn.study import FOLDS, Study, TextTable
from palpate.learn.table import r_squared
from palpate.model_export.schema import Layers

TOLD = ("ln d", "ln depth", "ln t", "E^-2/3", "ln E_fat", "in the fat")
"""What the tables by place are of; the last is how much of the lump's height lies in the fat."""

SURE = 0.8
"""A place is said where its odds are at least this."""

_IN_FAT, _DEPTH, _SIZE = range(3)
_D = OUTPUTS.index("ln d")


def true_values(seen: Observed, slope: float) -> Floats:
    """(n, 3), as `palpate.answer.layers.values`."""
    return values(seen.truth, slope)


def slope_of(y: Floats, Y: Floats) -> float:
    """c of ln d + c E^-2/3 whose errors spread least, from estimates and truth (n, outputs)."""
    error = (y - Y)[:, [OUTPUTS.index("ln d"), E_INV23]]
    covariance = np.cov(error.T)
    return float(-covariance[0, 1] / covariance[1, 1])


def fit_layers(z: Floats, y: Floats, seen: Observed) -> Layers:
    """Learn from estimates y (n, outputs) of lumps left out, at standardised features z (n, features)."""
    slope = slope_of(y, seen.truth)
    of = values(y, slope)
    error = true_values(seen, slope) - of
    spread = [fit_sigma(z, of[:, [j]], error[:, [j]], seen.group)[1][:, 0] for j in range(of.shape[1])]
    unit = Layers(LEVEL, slope, tuple(map(floats, spread)), ((1.0,) * 3,) * 3, SURE)
    score = np.abs(error) / half_widths(unit, z, of)
    layer = layer_of(of[:, 0])
    quantiles = [[quantile_of_part(q, layer == k, LEVEL) for k in (FAT, BORDER, GLAND)] for q in score.T]
    return Layers(LEVEL, slope, unit.spread, tuple((a, b, c) for a, b, c in quantiles), SURE)


@dataclass(frozen=True)
class AnywhereStudy(Study):
    """Estimates of lumps anywhere by models that have not seen them."""

    scope: Scope = field(default=ANYWHERE, kw_only=True)

    def layers(self, model: FittedModel) -> Layers:
        """Learnt from the lumps left out."""
        return fit_layers(model.polynomial.standard(self.inputs), self.y, self.seen)

    @cached_property
    def _added(self) -> tuple[Floats, Floats, Floats]:
        """What the host adds, half-widths and errors, (n, 3) each; each fold's learnt from the rest."""
        z, fold = standardised(self.inputs), self.seen.group % FOLDS
        found, half, error = (np.empty((len(z), 3)) for _ in range(3))
        for k in range(FOLDS):
            own, rest = fold == k, fold != k
            if own.any():
                part = fit_layers(z[rest], self.y[rest], self.seen.take(rest))
                found[own] = values(self.y[own], part.slope)
                half[own] = half_widths(part, z[own], found[own])
                error[own] = found[own] - true_values(self.seen.take(own), part.slope)
        return found, half, error

    @property
    def said(self) -> NDArray[np.int64]:
        """Where each lump is said to lie, (n), of `PLACES`."""
        found, half, _ = self._added
        return said(odds(found[:, _IN_FAT], half[:, _IN_FAT], LEVEL), SURE)

    def row(self, words: str) -> dict[str, object]:
        """As of any tissue, and how much of the lump's height lies in the fat."""
        found, half, error = (part[:, _IN_FAT] for part in self._added)
        return super().row(words) | of_output("in_fat", found - error, found, half, absolute=True)

    def depths_mm(self) -> Floats:
        """As of any tissue, with intervals that need no tie."""
        found, half, _ = (part[:, [_DEPTH]] for part in self._added)
        return np.exp(np.hstack([found, found - half, found + half]))

    def _depth(self) -> dict[str, float]:
        found, half, error = (part[:, _DEPTH] for part in self._added)
        return of_output("depth", found - error, found, half)

    @property
    def told(self) -> tuple[Floats, Floats, Floats]:
        """Estimates, half-widths and truth of `TOLD`, (n, 6) each."""
        found, half, error = self._added
        Y, six = self.seen.truth, []
        for name in TOLD:
            if name in OUTPUTS:
                j = OUTPUTS.index(name)
                six.append((self.y[:, j], self.half[:, j], Y[:, j]))
            else:
                j = _DEPTH if name == "ln depth" else _IN_FAT
                six.append((found[:, j], half[:, j], found[:, j] - error[:, j]))
        y, half, true = (np.column_stack(part) for part in zip(*six))
        return y, half, true

    def groups(self) -> Parts:
        """Those that the tables tell apart."""
        Y = self.seen.truth
        hard, depth = Y[:, E_INV23] <= HARD_BELOW, np.exp(true_values(self.seen, 0.0)[:, _DEPTH])
        return {
            "all": np.ones(len(Y), bool),
            **by_place(self.seen),
            "hard": hard,
            "soft": ~hard,
            "less than 6 mm deep": depth < 6,
            "hard and less than 6 mm deep": hard & (depth < 6),
        }

    def cells(self, words: str, of: NDArray[np.bool_]) -> list[str]:
        """R2 / median error / coverage of each of `TOLD`, and hard or soft right, of some strokes (n)."""
        out = []
        for name, y, half, true in zip(TOLD, *(part[of].T for part in self.told)):
            error = np.abs(y - true)
            absolute = name in ("E^-2/3", "in the fat")
            size = f"{np.median(error):.3f}" if absolute else f"{100 * np.expm1(np.median(error)):.1f} %"
            out.append(f"{r_squared(true, y):.2f} / {size} / {100 * (error <= half).mean():.0f}")
        right = (self.hard == (self.seen.truth[:, E_INV23] <= HARD_BELOW))[of].mean()
        return [words, *out, f"{100 * right:.0f}", str(len(np.unique(self.seen.group[of])))]

    def further_tables(self) -> list[TextTable]:
        """Estimates by place, where lumps are said to lie, and the combination of size and stiffness."""
        return [self._estimates(), self._places(), self._told_apart()]

    def _estimates(self) -> TextTable:
        rows = [self.cells(words, of) for words, of in self.groups().items() if of.sum() > 1]
        title = (
            f"Lumps anywhere, held out: R2 / median error / coverage of {100 * LEVEL:.0f} % intervals; "
            f"{100 * self.lost:.0f} % of strokes find no lump"
        )
        return title, ["lumps", *TOLD, "hard/soft", "n"], rows

    def _places(self) -> TextTable:
        true, said = true_place(self.seen), self.said
        rows = []
        for k in (FAT, BORDER, GLAND):
            of = said[true == k]
            shares = [f"{100 * (of == j).mean():.0f} %" for j in range(len(PLACES))] if len(of) else []
            rows.append([PLACES[k], *shares])
        told = said != UNSURE
        right = f"{100 * (said == true)[told].mean():.0f} %" if told.any() else ""
        rows.append(["right where it is said", right, "", "", ""])
        return "Where the lump lies (rows), and where it is said to lie", ["place", *PLACES], rows

    def combined(self, of: NDArray[np.bool_]) -> tuple[float, float, float]:
        """c, and the median errors of ln d alone and of ln d + c E^-2/3, whose errors have least spread."""
        y, Y = self.y[of], self.seen.truth[of]
        c, error = slope_of(y, Y), y - Y
        both = np.median(np.abs(error[:, _D] + c * error[:, E_INV23]))
        return c, float(np.median(np.abs(error[:, _D]))), float(both)

    def _told_apart(self) -> TextTable:
        """Where the combination's c is that of the group, and as it is told, with one c for all."""
        rows = []
        _, half, error = (part[:, _SIZE] for part in self._added)
        for words, of in self.groups().items():
            if of.sum() > 2:
                c, alone, both = self.combined(of)
                told = np.abs(error[of])
                sizes = [f"{100 * np.expm1(size):.1f} %" for size in (both, float(np.median(told)))]
                covered = f"{100 * (told <= half[of]).mean():.0f}"
                width = f"{100 * np.expm1(np.median(half[of])):.0f} %"
                rows.append([words, f"{100 * np.expm1(alone):.1f} %", f"{c:+.2f}", *sizes, width, covered])
        heads = [
            "lumps",
            "median error of d",
            "c",
            "of the combination",
            "as told",
            "half-width",
            "covered, %",
        ]
        return "Size and stiffness: the combination that is known, ln d + c E^-2/3", heads, rows
