"""Inverting strokes over a solid lump, or over tissue whose sides the face feels.

Units: mm, kPa.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from palpate.answer.fitted import Inverted
from palpate.inversion.kept import Felt
from palpate.inversion.pooled import pooled
from palpate.inversion.result import told_of_modes
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
    start = agreed([own for stroke, own in strokes if stroke.solid])
    searches = Searches(strokes, start, noise)
    modes = searches.lumps(_LUMPS)
    if not modes:
        return Inverted(number, problem=f"stroke {number}: no solid lump could be computed")
    weighed = [replace(one, mode=pooled(one.posterior, one.mode, start)) for one in modes]
    # the estimate speaks of a lump, but not of whether there is one
    k = int(np.argmax([one.mode.log_evidence for one in weighed]))
    word = weighed[k].mode.log_evidence + np.log(len({one.of.name for one in weighed}))
    lump = modes[k].mode.log_evidence
    for one in searches.plain(NONE, modes[k].mode.misfit.total):
        modes.append(one)
        mode = pooled(one.posterior, one.mode, start)
        evidence = word + (mode.log_evidence - lump + _SURER) / _TEMPERED
        weighed.append(replace(one, mode=replace(mode, log_evidence=evidence)))
    odds = odds_of((one.of.name, one.mode.log_evidence) for one in weighed)
    is_lump = odds.get(NONE.name, 0.0) < 0.5
    order = np.argsort([-one.mode.log_evidence for one in weighed], kind="stable")
    first, *others = (int(k) for k in order if weighed[k].of.lump == is_lump)
    likely = [weighed[k] for k in (first, *(k for k in others if odds[weighed[k].of.name] > _RARE))]
    said = told_of_modes(likely, odds, WIDER_SOLID if is_lump else WIDER_PLAIN)
    best = modes[first]
    return replace(said, laid=best.posterior.laid(best.mode.z, best.mode.found))
