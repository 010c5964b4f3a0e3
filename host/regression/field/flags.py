"""What the model says of strokes it should not believe: lumps outside its ranges, plain tissue."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from host.regression.field.bench import Bench
from host.regression.field.model import RANGE_HI, RANGE_LO, Answers, FieldModel
from host.regression.seen import Seen

DRAWS_OUTSIDE, DRAWS_PLAIN = 4, 4
_FIRST_OUTSIDE, _FIRST_PLAIN = 300, 400
WELL_OUTSIDE = 0.05
"""Share of an end by which a lump is called well outside."""


def flags(bench: Bench, model: FieldModel, noise: str, test: Seen, answers: Answers) -> dict[str, float]:
    """Shares flagged inside and outside the ranges that the model is for; false alarms on plain tissue.

    Inside are the test strokes, outside those over lumps of wider ranges (`design.OUTSIDE`), each as its own
    true d, h, E and force have it; none of either was seen in training or in choosing the margin.
    """
    flagged = ~answers.in_domain
    inside = answers.lump & ~outside(test)
    out = {"flagged_inside": float(flagged[inside].mean())}
    if bench.wide:
        every = np.arange(len(bench.wide))
        seen = bench.see(bench.wide, every, noise, DRAWS_OUTSIDE, _FIRST_OUTSIDE)
        seen = seen.take(outside(seen))
        wide = model.answer(seen)
        caught = ~wide.in_domain
        well = wide.lump & outside(seen, WELL_OUTSIDE)
        out |= {
            "outside_strokes": float(len(seen)),
            "outside_found": float(wide.lump.sum()),
            "outside_no_lump": float((~wide.lump).mean()),
            "flagged_outside": float(caught[wide.lump].mean()),
            "flagged_or_not_found_outside": float((caught | ~wide.lump).mean()),
            "flagged_well_outside": float(caught[well].mean()),
        }
    if bench.plain:
        every = np.arange(len(bench.plain))
        seen = bench.see(bench.plain, every, noise, DRAWS_PLAIN, _FIRST_PLAIN)
        out["plain_strokes"] = float(len(seen))
        out["false_alarms"] = float(model.lump(seen).mean())
    return out


def outside(seen: Seen, by: float = 0.0) -> NDArray[np.bool_]:
    """Whether the truth of each stroke lies outside the ranges by more than this share of an end."""
    lo, hi = np.array(RANGE_LO), np.array(RANGE_HI)
    return np.asarray(((lo * (1 - by) > seen.Y) | (hi * (1 + by) < seen.Y)).any(axis=1))
