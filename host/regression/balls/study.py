"""How good an answer is over balls and ellipsoids: every lump predicted without itself.

Beside it stands what the bundled plane-strain model makes of the same strokes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from palpate import models
from palpate.features.map_features import Floats
from palpate.link import answer
from palpate.link.events import OUTPUTS as WIRE
from palpate.model_export.fixed_point import force_map as force_maps
from palpate.model_export.fixed_point.reference import evaluate, inputs
from palpate.regression.balls.lumps import SolidLump, force_map_of
from palpate.regression.balls.model import OUTPUTS, STIFFNESS, fit_ball_model, quarters, truth
from palpate.regression.balls.observed import ObservedBalls, joined, observe
from palpate.regression.probe_model import HARD_BELOW
from palpate.regression.table import r_squared

DRAWS, FOLDS = 6, 8
LEVELS = ("typical", "real")
"""Of the table, unless others are asked for."""

TARGETS = {"d": 0.08, "width": 0.10, "depth": 0.05, "t": 0.03, "E_fat": 0.02, "hard_soft": 0.85}
"""Of one stroke with its press at typical noise: median errors, hard or soft right."""

_SAME = {"d": "d_mm", "t": "t_mm", "F": "F_N_per_m"}
"""Logarithms among our outputs, and the bundled model's names."""

_LEAST_MM = 0.01

ABSOLUTE = ("E_inv23", "offset")
"""Outputs whose error is a difference; of the others it is relative."""


@dataclass(frozen=True)
class BallStudy:
    """Estimates of lumps by models that have not seen them.

    seen: the strokes that found a lump; y, low, high : (n, outputs), by `model.OUTPUTS`, NaN where a model
    does not say; hard : (n), bool; lost: the share of strokes that found none.
    """

    seen: ObservedBalls
    y: Floats
    low: Floats
    high: Floats
    hard: NDArray[np.bool_]
    lost: float

    def row(self, words: str) -> dict[str, object]:
        """R2, median errors and coverage; lengths, forces and moduli relative, E^-2/3 and the offset not."""
        Y = truth(self.seen)
        inside = (self.low <= Y) & (self.high >= Y)
        told = np.isfinite(self.y).all(0)
        out: dict[str, object] = {"setting": words, "n": len(Y), "lumps": len(np.unique(self.seen.group))}
        for j in np.flatnonzero(told):
            name, error = short(OUTPUTS[j]), np.abs(self.y[:, j] - Y[:, j])
            out[f"{name}_r2"] = r_squared(Y[:, j], self.y[:, j])
            out[f"{name}_error"] = float(np.median(error if name in ABSOLUTE else np.expm1(error)))
            out[f"{name}_covered"] = float(inside[:, j].mean())
        out["hard_soft"] = float((self.hard == (Y[:, STIFFNESS] <= HARD_BELOW)).mean())
        worst = [inside[rows][:, told].mean(0) for rows in quarters(self.seen).values() if rows.any()]
        out["worst_quarter"] = float(np.min(worst))
        return out | {"not_found": self.lost}


def short(name: str) -> str:
    """An output's name without its link."""
    return {"E^-2/3": "E_inv23", "ln F/E_fat": "reach"}.get(name, name.removeprefix("ln "))


def held_out(seen: ObservedBalls, with_press: bool = True, folds: int = FOLDS) -> BallStudy:
    """Every lump predicted by models fitted, both stages and the intervals, without it.

    The force map alone has seen every lump: it knows nothing of what lies below.
    """
    fold = seen.group % folds
    parts, answers = [], []
    for k in range(folds):
        test = seen.take((fold == k) & seen.found)
        if len(test.found):
            parts.append(test)
            answers.append(fit_ball_model(seen.take(fold != k), with_press).answer(test))
    y, half = (np.concatenate([getattr(a, name) for a in answers]) for name in ("y", "half"))
    return BallStudy(
        joined(parts),
        y,
        y - half,
        y + half,
        np.concatenate([a.hard for a in answers]),
        float((~seen.found).mean()),
    )


def bundled(seen: ObservedBalls) -> tuple[BallStudy, float]:
    """What the bundled model, of endless cylinders, says of the same strokes; and of what share
    of them it says itself that they lie outside its domain."""
    spec = models.load()
    found = seen.take(seen.found)
    said = evaluate(spec, inputs(spec, found.X))
    # value, low and high of each of its outputs, (n, outputs, 3)
    spans = np.stack([said[part] for part in ("value", "low", "high")], axis=2)
    at = {name: spans[:, WIRE.index(name)] for name in WIRE}
    told = {f"ln {name}": np.log(at[wire]) for name, wire in _SAME.items()} | {"E^-2/3": at["E_inv23"]}
    depth = [answer.depth_mm(*map(tuple, of)) for of in zip(at["t_mm"], at["d_mm"], at["h"], strict=True)]
    told["ln depth"] = np.log(np.maximum(depth, _LEAST_MM))
    ends = np.full((3, *truth(found).shape), np.nan)
    for name, three in told.items():
        ends[:, :, OUTPUTS.index(name)] = three.T
    y, low, high = ends
    hard = y[:, STIFFNESS] < spec.hard_below
    study = BallStudy(found, y, low, high, hard, float((~seen.found).mean()))
    return study, float((~np.asarray(said["in_domain"])).mean())


def table_of(
    lumps: Sequence[SolidLump],
    levels: Sequence[str] = LEVELS,
    draws: int = DRAWS,
    seed: int = 1,
    step: Callable[[str], None] | None = None,
) -> pd.DataFrame:
    """Rows for each level of noise: the stroke alone, with its press, and the bundled model."""
    return pd.DataFrame(list(_rows(lumps, levels, draws, seed, step or (lambda what: None))))


def _rows(
    lumps: Sequence[SolidLump], levels: Sequence[str], draws: int, seed: int, step: Callable[[str], None]
) -> Iterator[dict[str, object]]:
    ours, spec = force_map_of(lumps), models.load()
    theirs = None if spec.force_map is None else force_maps.blob(spec.force_map)
    for level in levels:
        seen = joined([observe(lumps, level, 1000 * seed + k, ours) for k in range(draws)])
        step(f"{level}: seen")
        for with_press, words in ((False, "the stroke alone"), (True, "with its press")):
            yield held_out(seen, with_press).row(f"{level}, {words}")
            step(f"{level}, {words}: fitted")
        same = joined([observe(lumps, level, 1000 * seed + k, theirs) for k in range(draws)])
        study, flagged = bundled(same)
        yield study.row(f"{level}, plane-strain model") | {"flagged": flagged}
        step(f"{level}: bundled model asked")


def text_of(result: pd.DataFrame) -> tuple[list[str], list[list[str]]]:
    """Heads and rows: R2 / median error / the intervals' coverage of each output, and what is wanted."""
    columns = {
        "d": "d",
        "width": "width across",
        "depth": "depth",
        "t": "t",
        "E_inv23": "E^-2/3",
        "reach": "F/E_fat",
        "E_fat": "E_fat",
        "F": "F",
        "offset": "offset",
    }
    wanted = [f"{100 * TARGETS[n]:g} %" if n in TARGETS else "" for n in columns]
    rows = [["wanted", *wanted, f"{100 * TARGETS['hard_soft']:.0f}", "", "", "", ""]]
    for row in result.to_dict("records"):
        cells = [_cell(row, name) for name in columns]
        tail = [_percent(row, name) for name in ("hard_soft", "worst_quarter", "not_found", "flagged")]
        rows.append([str(row["setting"]), *cells, *tail, str(row["lumps"])])
    tail = ["hard/soft", "worst quarter", "not found", "flagged", "lumps"]
    return ["noise, input", *columns.values(), *tail], rows


def _percent(row: Mapping[Any, Any], name: str) -> str:
    value = row.get(name)
    return "" if not isinstance(value, float) or np.isnan(value) else f"{100 * value:.0f}"


def _cell(row: Mapping[Any, Any], name: str) -> str:
    error, r2 = row.get(f"{name}_error"), row.get(f"{name}_r2")
    if not isinstance(error, float) or not isinstance(r2, float) or np.isnan(error):
        return ""
    if name == "E_inv23":
        size = f"{error:.3f}"
    else:
        size = f"{error:.1f} mm" if name in ABSOLUTE else f"{100 * error:.1f} %"
    return f"{r2:.2f} / {size} / {_percent(row, f'{name}_covered')}"
