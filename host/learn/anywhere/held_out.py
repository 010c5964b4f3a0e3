"""Lumps anywhere, each predicted without itself: by place, where they are said to lie, what is known of size
where stiffness is not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from palpate.answer.layers import BORDER, FAT, GLAND, PLACES, UNSURE, half_widths, odds, said, values
from palpate.features.map_features import Floats
from palpate.learn.any_tissue.model import OUTPUTS, STIFFNESS, Parts, Scope, TissueModel, truth
from palpate.learn.any_tissue.study import FOLDS, TextTable, TissueStudy
from palpate.learn.anywhere.model import (
    ANYWHERE,
    SURE,
    fit_layers,
    places,
    slope_of,
    true_place,
    true_values,
)
from palpate.learn.conformal import LEVEL
from palpate.learn.probe_model import HARD_BELOW, standardised
from palpate.learn.table import r_squared
from palpate.model_export.schema import Layers

TOLD = ("ln d", "ln depth", "ln t", "E^-2/3", "ln E_fat", "in the fat")
"""What the tables by place are of; the last is how much of the lump's height lies in the fat."""
TARGETS = {"d": 0.116, "d_r2": 0.74, "depth": 0.066, "depth_r2": 0.94}
"""Of the laboratory, which had a reference press as well."""

_IN_FAT, _DEPTH, _SIZE = range(3)
_D = OUTPUTS.index("ln d")


@dataclass(frozen=True)
class AnywhereStudy(TissueStudy):
    """Estimates of lumps anywhere by models that have not seen them."""

    scope: ClassVar[Scope] = ANYWHERE
    targets: ClassVar[Mapping[str, float]] = MappingProxyType(TARGETS)
    training: ClassVar[Mapping[str, str]] = MappingProxyType({"place": "any"})

    def layers(self, model: TissueModel) -> Layers:
        """Learnt from the lumps left out."""
        return fit_layers(model.stroke.standard(self.inputs), self.y, self.seen)

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
        return super().row(words) | {
            "in_fat_r2": r_squared(found - error, found),
            "in_fat_error": float(np.median(np.abs(error))),
            "in_fat_covered": float((np.abs(error) <= half).mean()),
            "in_fat_half": float(np.median(half)),
        }

    def depths_mm(self) -> Floats:
        """As of any tissue, with intervals that need no tie."""
        found, half, _ = (part[:, [_DEPTH]] for part in self._added)
        return np.exp(np.hstack([found, found - half, found + half]))

    def _depth(self) -> dict[str, float]:
        found, half, error = (part[:, _DEPTH] for part in self._added)
        return {
            "depth_r2": r_squared(found - error, found),
            "depth_error": float(np.median(np.expm1(np.abs(error)))),
            "depth_covered": float((np.abs(error) <= half).mean()),
            "depth_half": float(np.median(half)),
        }

    @property
    def told(self) -> tuple[Floats, Floats, Floats]:
        """Estimates, half-widths and truth of `TOLD`, (n, 6) each."""
        found, half, error = self._added
        Y, six = truth(self.seen), []
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
        Y = truth(self.seen)
        hard, depth = Y[:, STIFFNESS] <= HARD_BELOW, np.exp(true_values(self.seen, 0.0)[:, _DEPTH])
        return {
            "all": np.ones(len(Y), bool),
            **places(self.seen),
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
        right = (self.hard == (truth(self.seen)[:, STIFFNESS] <= HARD_BELOW))[of].mean()
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
        y, Y = self.y[of], truth(self.seen)[of]
        c, error = slope_of(y, Y), y - Y
        both = np.median(np.abs(error[:, _D] + c * error[:, STIFFNESS]))
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
