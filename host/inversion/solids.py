"""Inverting strokes over a solid lump, or over tissue whose sides the face feels.

Units: mm, kPa.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from palpate.answer.fitted import Inverted
from palpate.inversion.kept import Felt
from palpate.inversion.result import told_of_classes, told_of_modes
from palpate.inversion.solid_classes import BALL, ELLIPSOID, NONE
from palpate.inversion.solid_modes import Searches
from palpate.inversion.start import agreed
from palpate.inversion.under import odds_of
from palpate.inversion.widening import WIDER_PLAIN, WIDER_SOLID
from palpate.sim.probe.noise import Noise

_LUMPS = (ELLIPSOID, BALL)
_RARE = 0.01
_SURER, _TEMPERED = 9.0, 4.0
"""A lump must be so much likelier than none, as a logarithm, and what lies over counts a part of itself: what
mesh and emulator get wrong is explained by whatever has more unknowns."""


def invert_solid(strokes: Sequence[Felt], noise: Noise) -> Inverted:
    """Invert strokes over one lump that ends across them; as `palpate.inversion.strokes.invert_together`."""
    number = strokes[0][0].stroke
    searches = Searches(strokes, agreed([own for stroke, own in strokes if stroke.solid]), noise)
    modes = searches.lumps(_LUMPS)
    if not modes:
        return Inverted(number, problem=f"stroke {number}: no solid lump could be computed")
    best = max(modes, key=lambda one: one.mode.log_evidence).mode
    lump = best.log_evidence + np.log(len({one.of.name for one in modes}))
    for one in searches.plain(NONE, best.misfit.total):
        evidence = lump + (one.mode.log_evidence - best.log_evidence + _SURER) / _TEMPERED
        modes.append(replace(one, mode=replace(one.mode, log_evidence=evidence)))
    odds = odds_of((one.of.name, one.mode.log_evidence) for one in modes)
    is_lump = odds.get(NONE.name, 0.0) < 0.5
    modes.sort(key=lambda one: -one.mode.log_evidence)
    first, *others = (one for one in modes if one.of.lump == is_lump)
    likely = [first, *(one for one in others if odds[one.of.name] > _RARE)]
    if is_lump:
        names = [one.of.name for one in likely]
        best_of_each = [likely[names.index(name)] for name in dict.fromkeys(names)]
        said = told_of_classes(best_of_each, odds, WIDER_SOLID)
    else:
        said = told_of_modes(likely, odds, WIDER_PLAIN)
    return replace(said, laid=first.posterior.laid(first.mode.z, first.mode.found))
