"""How a model treats strokes outside its domain: lumps outside its ranges, plain tissue."""

from __future__ import annotations

import numpy as np

from palpate.features.map_features import Floats
from palpate.learn.model import FittedModel
from palpate.learn.observed import Observed
from palpate.learn.probe_model import E_INV23, OUTPUTS
from palpate.learn.scopes import Scope
from palpate.learn.score import share

WELL_OUTSIDE, NEAR = np.log(1.05), np.log(1.13)
"""By 5 % of an end; lumps further out would cost those within the ranges more than they bring."""


def facts_of(
    model: FittedModel, flagged_inside: float, outside: Observed | None, plain: Observed | None
) -> dict[str, float]:
    """Shares flagged inside and outside the ranges; false alarms on plain tissue.

    Neither `outside`, over lumps outside the ranges, nor `plain` was fitted to.
    """
    out = {"flagged_inside": flagged_inside, "flag_margin_half_widths": model.domain.margin}
    if outside is not None:
        found, flagged = outside.found, ~model.answer(outside).in_domain
        well = found & (beyond(outside, model.scope) > WELL_OUTSIDE)
        out |= {
            "outside_strokes": float(len(outside)),
            "outside_found": float(found.sum()),
            "outside_no_lump": float((~found).mean()),
            "flagged_outside": share(flagged[found]),
            "flagged_or_not_found_outside": float((flagged | ~found).mean()),
            "flagged_well_outside": share(flagged[well]),
        }
    if plain is not None:
        out |= {
            "plain_strokes": float(len(plain)),
            "false_alarms": float(plain.found.mean()),
            "false_alarms_not_flagged": float((plain.found & model.answer(plain).in_domain).mean()),
        }
    return out


def beyond(seen: Observed, scope: Scope) -> Floats:
    """How far the truth lies beyond the ranges, (n), on a logarithmic scale; negative inside."""
    out = np.full(len(seen), -np.inf)
    for name in scope.ranges:
        (low, high), y = scope.limits(name), seen.of(name)
        if name == OUTPUTS[E_INV23]:
            low, high, y = -np.inf, float(np.log(high)), np.log(y)
        out = np.maximum(out, np.maximum(low - y, y - high))
    return out
