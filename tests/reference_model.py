"""A made-up model of two stages whose first is of real presses, so that a reference press means something.

The numbers are a straight line through the presses of 1300 lumps in random tissue: 7 % in F/E_fat, 19 % in t.
"""

from __future__ import annotations

import dataclasses

from palpate.learn.scopes import PRESS
from palpate.model_export.schema import Estimate, FirstStage, Joining, ModelSpec
from tests.model_export import synthetic

CENTRE = (-0.27, 0.21, 0.67, 1.19, 1.44, 1.69, 0.85, 0.59, 0.35)
SCALE = (0.37, 0.36, 0.37, 0.15, 0.16, 0.14, 0.15, 0.16, 0.15)
LINES = {
    "ln_reach": (1.556, 0.067, -0.033, -0.075, -0.084, 0.093, 0.057, -0.571, -0.019, 0.297),
    "ln_t": (2.749, -0.2, 0.256, 0.267, 0.035, 0.026, -0.061, 0.82, -0.22, -0.509),
    "ln_layers": (3.024, -0.293, 0.225, 0.522, 0.03, -0.037, -0.013, 0.462, 0.001, -0.246),
}
ENDS = {"ln_reach": (0.6, 2.6), "ln_t": (1.0, 4.2), "ln_layers": (1.4, 4.4)}
JOINING = Joining((0.5, 0.5, 0.5), ((12.0,), (0.0, 5.0), (0.0, 0.0, 10.0)), 12.0)


def model(joining: Joining | None = JOINING) -> ModelSpec:
    """The second stage is made up; no stroke is without a lump to it."""
    field = synthetic.model("field")
    lo, hi = (tuple(c + k * s for c, s in zip(CENTRE, SCALE)) for k in (-5.0, 5.0))
    estimates = tuple(Estimate(name, *ENDS[name], line) for name, line in LINES.items())
    terms = ((), *((i,) for i in range(9)))
    first = FirstStage(PRESS, CENTRE, SCALE, lo, hi, terms, estimates, joining)
    last = len(field.features) - 3

    def with_theirs(values, theirs):
        return (*values[:last], *theirs)

    middle = tuple(LINES[name][0] for name in LINES)
    domain = dataclasses.replace(
        field.domain,
        lo=with_theirs(field.domain.lo, (0.6, 1.1, 1.5)),
        hi=with_theirs(field.domain.hi, (2.6, 4.2, 4.4)),
    )
    return dataclasses.replace(
        field,
        features=with_theirs(field.features, LINES),
        centre=with_theirs(field.centre, middle),
        scale=with_theirs(field.scale, (0.4, 0.5, 0.4)),
        clip_lo=with_theirs(field.clip_lo, (0.5, 1.0, 1.4)),
        clip_hi=with_theirs(field.clip_hi, (2.7, 4.3, 4.5)),
        domain=domain,
        first=first,
        features_version=2,
        lump=(),
    ).validate()
