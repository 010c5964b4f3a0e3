"""What lies under a face, as its array feels it: classes, forward models and odds of one stroke or press."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from palpate.inversion.classes import ANYWHERE, BORDER, CLASSES, Class, under
from palpate.inversion.emulated import EmulatedForward
from palpate.inversion.felt import FeltStroke
from palpate.inversion.forward import Forward
from palpate.sim.tissue import Settings
from palpate.sim.tissue.reading import places_read
from palpate.wire.cells import PITCH_MM, SHAPE

AUTO = "auto"
LUMPS = (BORDER.name, ANYWHERE.name)
"""The latter holds the former."""
_HALF_MM = SHAPE[0] * PITCH_MM / 2
_USUAL_HALF_MM = 12.0
_SIDES_MM = 160.0


def classes_over(felt: FeltStroke, kind: str) -> list[Class]:
    """The classes that are compared, the one with most unknowns first, as this face feels them."""
    chosen = [CLASSES[kind]] if kind != AUTO else list(reversed(CLASSES.values()))
    return [under(felt.face, of, _HALF_MM) for of in chosen]


def emulated_of(of: Class, strokes: Sequence[FeltStroke]) -> EmulatedForward:
    """The emulator of a class, for strokes over one lump."""
    return EmulatedForward(of, [(len(felt.place_mm), felt.press) for felt in strokes])


def forward_of(of: Class, settings: Settings, strokes: Sequence[FeltStroke]) -> Forward:
    """The forward model of a class on one mesh, for strokes over one lump, or for one press alone."""
    sizes = [(len(felt.place_mm), felt.press) for felt in strokes if not felt.alone]
    if _HALF_MM > _USUAL_HALF_MM and sizes:  # a wide face must not come too near the tissue's sides
        settings = replace(settings, left_mm=-_SIDES_MM, right_mm=_SIDES_MM)
    return Forward(of, settings, places_read(SHAPE[0], PITCH_MM), sizes)


def odds_of(modes: Iterable[tuple[str, float]]) -> dict[str, float]:
    """Of classes by the logarithms of their modes' evidence; all are as likely beforehand."""
    evidence: dict[str, float] = {}
    for name, of_mode in modes:
        evidence[name] = max(evidence.get(name, -np.inf), of_mode)
    most = max(evidence.values())
    share = {name: float(np.exp(value - most)) for name, value in evidence.items()}
    return {name: share[name] / sum(share.values()) for name in share}
