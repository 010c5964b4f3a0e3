"""How the model treats strokes outside its domain: lumps outside its ranges, plain tissue."""

from __future__ import annotations

import itertools
from statistics import NormalDist

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from palpate.learn.field.bench import Bench
from palpate.learn.field.model import RANGE_HI, RANGE_LO, Answers, FieldModel
from palpate.learn.observed import ObservedStrokes
from palpate.learn.probe_model import to_link

DRAWS_OUTSIDE, DRAWS_PLAIN = 4, 4
_FIRST_OUTSIDE, _FIRST_PLAIN = 300, 400
WELL_OUTSIDE = 0.05
"""Share of an end by which a lump is called well outside."""

DISTANCES = (-np.inf, -2.0, -1.0, -0.5, 0.0, 0.25, 0.5, 1.0, 2.0, 4.0, np.inf)
"""Half-widths beyond the nearest end of the ranges, negative inside."""


def flags(
    bench: Bench, model: FieldModel, noise: str, test: ObservedStrokes, answers: Answers
) -> tuple[dict[str, float], pd.DataFrame]:
    """Shares flagged inside and outside the ranges that the model is for; false alarms on plain tissue.

    Inside are the test strokes, outside those over lumps of wider ranges (`design.OUTSIDE`), each as its own
    true d, h, E and force have it; none of either was seen in training or in choosing the margin.

    Returns
    -------
    facts : dict of shares
    by_distance : DataFrame
        See `by_distance`.
    """
    flagged = ~answers.in_domain
    inside = answers.lump & ~outside(test)
    out = {"flagged_inside": float(flagged[inside].mean()), "flag_margin_half_widths": model.domain.margin}
    judged = [(test, answers)]
    if bench.wide:
        every = np.arange(len(bench.wide))
        observed = bench.observe(bench.wide, every, noise, DRAWS_OUTSIDE, _FIRST_OUTSIDE, model.recipe)
        observed = observed.take(outside(observed))
        wide = model.answer(observed)
        judged.append((observed, wide))
        caught = ~wide.in_domain
        well = wide.lump & outside(observed, WELL_OUTSIDE)
        out |= {
            "outside_strokes": float(len(observed)),
            "outside_found": float(wide.lump.sum()),
            "outside_no_lump": float((~wide.lump).mean()),
            "flagged_outside": float(caught[wide.lump].mean()),
            "flagged_or_not_found_outside": float((caught | ~wide.lump).mean()),
            "flagged_well_outside": float(caught[well].mean()),
        }
    if bench.plain:
        every = np.arange(len(bench.plain))
        observed = bench.observe(bench.plain, every, noise, DRAWS_PLAIN, _FIRST_PLAIN, model.recipe)
        out["plain_strokes"] = float(len(observed))
        out["false_alarms"] = float(model.lump(observed).mean())
    return out, by_distance(model, judged)


def by_distance(model: FieldModel, judged: list[tuple[ObservedStrokes, Answers]]) -> pd.DataFrame:
    """Share flagged against how far the truth lies beyond the ranges, of the strokes that found a lump.

    A distance is counted in half-widths of the estimate's own interval, from the end that is passed
    furthest, or is nearest.

    Returns
    -------
    DataFrame
        Columns from, to (half-widths), strokes, flagged, and unbiased: the share that the same margin would
        flag if the estimates' errors were normal, without bias, and just as wide as the intervals say.
    """
    distance, flagged = [], []
    for observed, answers in judged:
        found = answers.lump
        distance.append(model.domain.beyond(to_link(observed.Y[found]), answers.half[found]))
        flagged.append(~answers.in_domain[found])
    t, caught = np.concatenate(distance), np.concatenate(flagged)
    normal = NormalDist()
    errors_a_half = normal.inv_cdf((1 + model.widths.level) / 2)
    rows = []
    for low, high in itertools.pairwise(DISTANCES):
        cell = (t > low) & (t <= high)
        if cell.any():
            ideal = [normal.cdf(errors_a_half * (float(x) - model.domain.margin)) for x in t[cell]]
            row = {"from": low, "to": high, "strokes": int(cell.sum()), "flagged": float(caught[cell].mean())}
            rows.append(row | {"unbiased": float(np.mean(ideal))})
    return pd.DataFrame(rows, columns=["from", "to", "strokes", "flagged", "unbiased"])


def outside(observed: ObservedStrokes, by: float = 0.0) -> NDArray[np.bool_]:
    """Whether the truth of each stroke lies outside the ranges by more than this share of an end."""
    lo, hi = np.array(RANGE_LO), np.array(RANGE_HI)
    return np.asarray(((lo * (1 - by) > observed.Y) | (hi * (1 + by) < observed.Y)).any(axis=1))
