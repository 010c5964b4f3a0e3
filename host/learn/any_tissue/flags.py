"""How a model treats strokes that it is not for: lumps outside its ranges, plain tissue."""

from __future__ import annotations

import numpy as np

from palpate.features.map_features import Floats
from palpate.learn.any_tissue.model import ON_BORDER, OUTPUTS, Scope, TissueModel, truth
from palpate.learn.any_tissue.observed import ObservedInTissue

WELL_OUTSIDE, NEAR = np.log(1.05), np.log(1.13)
"""By 5 % of an end; lumps further out would cost those within the ranges more than they bring."""


def facts_of(
    model: TissueModel,
    flagged_inside: float,
    outside: ObservedInTissue | None,
    plain: ObservedInTissue,
    scope: Scope = ON_BORDER,
) -> dict[str, float]:
    """Shares flagged inside and outside the ranges; false alarms on plain tissue."""
    return {
        "flagged_inside": flagged_inside,
        "flag_margin_half_widths": model.domain.margin,
        **(outside_facts(model, outside, scope) if outside is not None else {}),
        "plain_strokes": float(len(plain.found)),
        "false_alarms": float(plain.found.mean()),
        "false_alarms_not_flagged": float((plain.found & model.in_domain(plain)).mean()),
    }


def outside_facts(
    model: TissueModel, outside: ObservedInTissue, scope: Scope = ON_BORDER
) -> dict[str, float]:
    """Of strokes over lumps outside the ranges: how many find none, how many of the others are flagged."""
    caught = ~model.in_domain(outside) & outside.found
    far = outside.found & (beyond(outside, scope) > WELL_OUTSIDE)
    return {
        "outside_strokes": float(len(outside.found)),
        "outside_no_lump": float((~outside.found).mean()),
        "flagged_outside": float(caught[outside.found].mean()),
        "flagged_well_outside": float(caught[far].mean()) if far.any() else float("nan"),
    }


def beyond(seen: ObservedInTissue, scope: Scope = ON_BORDER) -> Floats:
    """How far the truth lies beyond the ranges, (n), on a logarithmic scale."""
    Y, out = truth(seen), np.full(len(seen.X), -np.inf)
    for name, ends in scope.ranges.items():
        y = Y[:, OUTPUTS.index(name)]
        low, high = (-np.inf, float(np.log(ends[1]))) if name == "E^-2/3" else ends
        past = np.maximum(low - y, (np.log(y) if name == "E^-2/3" else y) - high)
        out = np.maximum(out, past)
    return out
