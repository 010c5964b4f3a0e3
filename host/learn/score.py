"""How good a field model is on unseen strokes."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from palpate.features.map_features import Floats
from palpate.learn.model import Answers
from palpate.learn.observed import Observed
from palpate.learn.probe_model import E_INV23, HARD_BELOW
from palpate.learn.table import TARGETS, r_squared

NEAR_THE_BORDER = (7.0, 15.0)
"""Stiffness near which a stroke cannot tell hard from soft."""

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class HeldOutRow:
    """One line of the held-out table."""

    noise: str
    recipe: str
    strokes: int
    terms: int
    scores: dict[str, float]
    not_found: int

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        head = {"noise": self.noise, "model": self.recipe, "strokes": self.strokes, "terms": self.terms}
        return {**head, "not_found": self.not_found, **flat(self.scores)}


def share(of: Mask) -> float:
    """Of those that hold; nan of none."""
    return float(of.mean()) if len(of) else float("nan")


def is_hard(observed: Observed) -> Mask:
    """Lumps of E >= 10."""
    return observed.truth[:, E_INV23] <= HARD_BELOW + 1e-12


def scores(observed: Observed, value: Floats, answered: Mask, border: float = HARD_BELOW) -> dict[str, float]:
    """R2 and median relative error of every output, hard or soft right, over the strokes answered.

    A lump whose estimate of E^-2/3 is under `border` is called hard.
    """
    Y, v = observed.values[answered], value[answered]
    out: dict[str, float] = {"n": float(len(Y))}
    for j, name in enumerate(TARGETS):
        out[f"{name}_r2"] = r_squared(Y[:, j], v[:, j])
        error = np.abs(v[:, j] - Y[:, j])
        out[f"{name}_error"] = float(np.median(error if j == E_INV23 else error / Y[:, j]))
    right = (v[:, E_INV23] < border) == is_hard(observed)[answered]
    E = Y[:, E_INV23] ** -1.5
    far = (NEAR_THE_BORDER[0] > E) | (NEAR_THE_BORDER[1] < E)
    out["hard_soft"] = float(right.mean())
    out["hard_soft_far"] = share(right[far])
    return out


def of_output(
    name: str, true: Floats, value: Floats, half: Floats | None, absolute: bool = False
) -> dict[str, float]:
    """R2, median error, coverage and median half-width of one output, (n) each.

    Errors of logarithms are given as shares, unless they are to be `absolute`; half: None where there are no
    intervals.
    """
    error = np.abs(value - true)
    size = float(np.median(error if absolute else np.expm1(error)))
    out = {f"{name}_r2": r_squared(true, value), f"{name}_error": size}
    if half is not None:
        out |= {f"{name}_covered": float((error <= half).mean()), f"{name}_half": float(np.median(half))}
    return out


def quarters(values: Mapping[str, Floats]) -> dict[str, Mask]:
    """Each quarter of each of these, (n), by name."""
    out: dict[str, Mask] = {}
    for name, of in values.items():
        edges = np.quantile(of, [0, 0.25, 0.5, 0.75, 1])
        for k in range(4):
            last = of <= edges[k + 1] if k == 3 else of < edges[k + 1]
            out[f"{name} {edges[k]:.3g} to {edges[k + 1]:.3g}"] = (of >= edges[k]) & last
    return out


def coverage(observed: Observed, answers: Answers, answered: Mask) -> pd.DataFrame:
    """Share of true values inside their intervals: overall, hard and soft, and in each quarter.

    Returns
    -------
    DataFrame
        Rows: groups; columns: n, the five outputs' coverage, and the median half-widths (relative for
        F, t, d and h, absolute for E^-2/3).
    """
    true = observed.values[:, : len(TARGETS)]
    inside = (answers.low - 1e-12 <= true) & (answers.high + 1e-12 >= true)
    part = observed.take(answered)
    hard = is_hard(part)
    of = {name: part.values[:, TARGETS.index(name)] for name in ("d", "h", "E_inv23", "F")}
    groups = {"all": np.ones(len(part), bool), "soft": ~hard, "hard": hard, **quarters(of)}
    rows = {}
    for name, group in groups.items():
        row: dict[str, Any] = {"n": int(group.sum())}
        row |= dict(zip(TARGETS, inside[answered][group].mean(axis=0)))
        half = np.median(answers.half[answered][group], axis=0)
        row |= {f"half_{t}": h for t, h in zip(TARGETS, half)}
        rows[name] = row
    return pd.DataFrame.from_dict(rows, orient="index")


def hardness(observed: Observed, answers: Answers, answered: Mask) -> dict[str, float]:
    """How often the answer is hard or soft rather than unsure, and how often that is right."""
    said, hard = answers.hardness[answered], is_hard(observed)[answered]
    decided = said != "unsure"
    wrong = (said == "hard") != hard
    return {
        "decided": float(decided.mean()),
        "wrong_of_decided": share(wrong[decided]),
        "hard_called_soft": float((hard & (said == "soft")).sum() / max(hard.sum(), 1)),
        "soft_called_hard": float((~hard & (said == "hard")).sum() / max((~hard).sum(), 1)),
    }


def bounds(answers: Answers, answered: Mask) -> dict[str, float]:
    """Where stiffness saturates the interval of E is one-sided: how often, and what bound is given."""
    low, high = answers.low[answered, E_INV23], answers.high[answered, E_INV23]
    open_above = low <= 1000.0 ** (-2 / 3) + 1e-9
    bound = high[open_above] ** -1.5
    return {
        "E_is_a_bound": float(open_above.mean()),
        "median_bound": float(np.median(bound)) if len(bound) else float("nan"),
    }


def found_by(observed: Observed, lump: Mask) -> pd.DataFrame:
    """Detectability map: share of strokes over lumps in which one is found, by d, h and E.

    Returns
    -------
    DataFrame
        Columns d_mm, h, E (each a range), n, found.
    """
    _, _, d, h, E_inv23 = observed.values[:, : len(TARGETS)].T
    E = E_inv23**-1.5
    d_edges, h_edges, E_edges = (5, 10, 15, 20.001), (0.3, 0.7, 1.1, 1.501), (2, 4, 10, 1000.1)
    rows = []
    for d0, d1 in itertools.pairwise(d_edges):
        for h0, h1 in itertools.pairwise(h_edges):
            for E0, E1 in itertools.pairwise(E_edges):
                cell = (d >= d0) & (d < d1) & (h >= h0) & (h < h1) & (E >= E0) & (E < E1)
                if cell.any():
                    rows.append(
                        {
                            "d_mm": f"{d0:g} to {d1:.0f}",
                            "h": f"{h0:g} to {h1:.1f}",
                            "E": f"{E0:g} to {E1:.0f}",
                            "n": int(cell.sum()),
                            "found": float(lump[cell].mean()),
                        }
                    )
    return pd.DataFrame(rows)


def ordered(ranges: Iterable[str]) -> list[str]:
    """Ranges such as "5 to 10", each once, by their lower end."""
    return sorted(set(ranges), key=lambda text: float(text.split()[0]))


def visits(observed: Observed, y: Floats, answered: Mask) -> pd.DataFrame:
    """The smallest change of diameter that two visits can tell apart, in percent, at 95 %.

    What is the same at both visits cancels: the spread of repeated estimates of one lump decides. Two
    visits of one stroke each differ by 1.96 sqrt(2) standard deviations at most.
    """
    rows = []
    true = observed.values
    table = pd.DataFrame({"group": observed.group, "ln_d": y[:, 2], "d": true[:, 2], "h": true[:, 3]})[
        answered
    ]
    spread = table.groupby("group").agg(
        n=("ln_d", "size"), variance=("ln_d", "var"), d=("d", "first"), h=("h", "first")
    )
    spread = spread[spread["n"] > 1]
    for name, column, edges in (("d", "d", (5, 10, 15, 20.001)), ("h", "h", (0.3, 0.7, 1.1, 1.501))):
        for a, b in itertools.pairwise(edges):
            cell = spread[(spread[column] >= a) & (spread[column] < b)]
            if len(cell):
                sd = float(np.sqrt(cell["variance"].median()))
                change = 100 * (np.exp(1.96 * np.sqrt(2) * sd) - 1)
                rows.append({"group": f"{name} {a:g} to {b:.3g}", "lumps": len(cell), "percent": change})
    return pd.DataFrame(rows)


def averaged(observed: Observed, y: Floats, answered: Mask, strokes: int = 4) -> tuple[Observed, Floats, int]:
    """Several strokes of each lump as one: their mean truth, their mean prediction (link scale).

    Returns
    -------
    observed, y : of the lumps that were found in every one of the first `strokes` strokes
    lost : int
        Lumps left out because they were found in some strokes only, or in none.
    """
    keep, means, forces = [], [], []
    lumps = np.unique(observed.group)
    for lump in lumps:
        rows = np.flatnonzero(observed.group == lump)[:strokes]
        if len(rows) == strokes and answered[rows].all():
            keep.append(rows[0])
            means.append(y[rows].mean(axis=0))
            forces.append(observed.truth[rows, 0].mean())
    part = observed.take(np.array(keep, int))
    if keep:
        part.truth[:, 0] = forces
    return part, np.array(means), len(lumps) - len(keep)


def flat(rows: Mapping[str, Any]) -> dict[str, Any]:
    """A mapping with NaN as None, for JSON."""
    return {k: (None if isinstance(v, float) and np.isnan(v) else v) for k, v in rows.items()}
