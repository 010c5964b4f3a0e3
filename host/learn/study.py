"""How good an answer is in tissue that the probe knows nothing about: every lump predicted without itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from palpate.features.map_features import Floats
from palpate.learn.model import FittedModel, depth_mm, fit_model
from palpate.learn.observed import Observed, joined
from palpate.learn.probe_model import E_INV23, HARD_BELOW
from palpate.learn.scopes import BORDER, Parts, Scope
from palpate.learn.score import of_output
from palpate.learn.table import r_squared
from palpate.model_export.vocabulary import SYMBOLS

if TYPE_CHECKING:
    from palpate.model_export.schema import Layers

DRAWS, FOLDS = 3, 5
TextTable = tuple[str, list[str], list[list[str]]]
"""Title, heads, rows."""

_LEAST_MM = 1e-3
"""Of a depth: where t and d contradict each other it would be none."""


@dataclass(frozen=True)
class Study:
    """Estimates of lumps by models that have not seen them.

    seen: the strokes that found a lump; y, half : (n, outputs), by `model.OUTPUTS`; hard : (n), bool;
    in_domain : (n), bool, where it was asked; lost: share of strokes without a lump; inputs : (n, features),
    what the second stage had, where it was kept.
    """

    seen: Observed
    y: Floats
    half: Floats
    hard: NDArray[np.bool_]
    lost: float
    in_domain: NDArray[np.bool_] | None = None
    inputs: Floats = field(default_factory=lambda: np.empty((0, 0)), kw_only=True)
    scope: Scope = field(default=BORDER, kw_only=True)

    @property
    def parts(self) -> Parts:
        """Those that are judged apart."""
        return self.scope.parts(self.seen)

    def layers(self, model: FittedModel) -> Layers | None:
        """The document's part on the layer that a lump lies in, where lumps lie in several."""
        return None

    def further_tables(self) -> list[TextTable]:
        """What else is printed of these lumps."""
        return []

    @classmethod
    def of(cls, model: FittedModel, seen: Observed, **more: Any) -> Self:
        """What a model says of strokes over lumps that it has not met; more: fields of the class."""
        found = seen.take(seen.found)
        said, lost = model.answer(found), float((~seen.found).mean())
        return cls(found, said.y, said.half, said.hard, lost, said.in_domain, scope=model.scope, **more)

    @classmethod
    def held_out(
        cls,
        seen: Observed,
        with_press: bool = True,
        folds: int = FOLDS,
        step: Callable[[str], None] | None = None,
        rim: Observed | None = None,
        scope: Scope | None = None,
    ) -> Self:
        """Every lump predicted by models fitted, both stages and the intervals, without it.

        rim: strokes over lumps outside the ranges, that all models are fitted to as well; scope: by default
        the class's own.

        The force map alone has seen every lump: it knows nothing of what lies below.
        """
        fold = seen.group % folds
        scope = scope or cls.scope
        if not with_press:
            scope = scope.stroke_alone
        parts, answers, inputs = [], [], []
        for k in range(folds):
            model = fit_model(scope, seen.take(fold != k), rim=rim)
            parts.append(seen.take((fold == k) & seen.found))
            answers.append(model.answer(parts[-1]))
            inputs.append(model.inputs(parts[-1]))
            if step:
                step(f"fold {k + 1} of {folds}")
        return cls(
            joined(parts),
            np.concatenate([a.y for a in answers]),
            np.concatenate([a.half for a in answers]),
            np.concatenate([a.hard for a in answers]),
            float((~seen.found).mean()),
            np.concatenate([a.in_domain for a in answers]),
            inputs=np.concatenate(inputs),
            scope=scope,
        )

    def row(self, words: str) -> dict[str, object]:
        """R2, median errors and coverage; lengths, forces and moduli relative, E^-2/3 absolute."""
        Y = self.seen.truth[:, : self.scope.estimated]
        inside = np.abs(self.y - Y) <= self.half
        out: dict[str, object] = {"setting": words, "n": len(Y), "lumps": len(np.unique(self.seen.group))}
        for j, name in enumerate(SYMBOLS[: self.scope.estimated]):
            out |= of_output(name, Y[:, j], self.y[:, j], self.half[:, j], absolute=j == E_INV23)
        out |= self._depth()
        out["hard_soft"] = float((self.hard == (Y[:, E_INV23] <= HARD_BELOW)).mean())
        worst = [inside[rows].mean(0) for rows in self.parts.values() if rows.any()]
        out["worst_quarter"] = float(np.min(worst))
        return out | {"not_found": self.lost, "flagged": self.flagged}

    @property
    def flagged(self) -> float:
        """Share out of the domain; NaN where it was not asked."""
        return float("nan") if self.in_domain is None else float((~self.in_domain).mean())

    def depths_mm(self) -> Floats:
        """Fat over the lump, value, low and high (n, 3), from t, d and h (`palpate.spans`)."""
        return np.maximum(depth_mm(self.y, self.half), _LEAST_MM)

    def _depth(self) -> dict[str, float]:
        value, low, high = self.depths_mm().T
        true = np.exp(self.seen.of("ln depth"))
        return {
            "depth_r2": r_squared(np.log(true), np.log(value)),
            "depth_error": float(np.median(np.abs(value / true - 1))),
            "depth_covered": float(((low <= true) & (true <= high)).mean()),
            "depth_half": float(np.median(np.log(high / low) / 2)),
        }


_COLUMNS = {
    "d": "d",
    "width": "width across",
    "depth": "depth",
    "t": "t",
    "h": "h",
    "E_inv23": "E^-2/3",
    "E_fat": "E_fat",
    "F": "F",
    "place": "place across",
    "in_fat": "in the fat",
}


def text_of(
    result: pd.DataFrame, targets: Mapping[str, float] = BORDER.targets
) -> tuple[list[str], list[list[str]]]:
    """Heads and rows: R2 / median error / the intervals' coverage of each output, and what is wanted."""
    names = [name for name in _COLUMNS if f"{name}_error" in result]
    share = ("hard_soft", "worst_quarter", "not_found")
    shares = (*share, *(("flagged",) if "flagged" in result else ()))
    rows = [
        ["wanted", *(_wanted(name, targets) for name in names), *(_share(targets, n) for n in shares), ""]
    ]
    for row in result.to_dict("records"):
        cells = [cell(row, name) for name in names]
        rows.append([str(row["setting"]), *cells, *(_share(row, name) for name in shares), str(row["lumps"])])
    words = [name.replace("hard_soft", "hard/soft").replace("_", " ") for name in shares]
    return ["noise, input", *(_COLUMNS[name] for name in names), *words, "lumps"], rows


def _wanted(name: str, targets: Mapping[str, float]) -> str:
    r2 = [f"{targets[f'{name}_r2']}"] if f"{name}_r2" in targets else []
    return " / ".join([*r2, *([f"{100 * targets[name]:g} %"] if name in targets else [])])


def cell(row: Mapping[Any, Any], name: str) -> str:
    """R2 / median error / coverage in per cent of an output in a row of scores; "" where it has none."""
    error, r2, covered = (row.get(f"{name}_{word}") for word in ("error", "r2", "covered"))
    if not isinstance(error, float) or np.isnan(error):
        return ""
    plain = f"{error:.3f}"
    size = {"E_inv23": plain, "in_fat": plain, "place": f"{error:.1f} mm"}.get(name, f"{100 * error:.1f} %")
    known = [f"{r2:.3f}"] if isinstance(r2, float) else []
    return " / ".join([*known, size, *([f"{100 * covered:.0f}"] if isinstance(covered, float) else [])])


def _share(row: Mapping[Any, Any], name: str) -> str:
    value = row.get(name)
    return "" if not isinstance(value, float) or np.isnan(value) else f"{100 * value:.0f}"
