"""Recipes: which features in which terms. `FIELD` is the model for use, the others are for comparison."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from palpate.features.map_features import Floats
from palpate.learn.observed import OF_THE_DISPLACEMENT
from palpate.learn.ridge import Term, all_terms, fit_ridge, importance, monomials

PILOT_FEATURES = (
    "ln_force",
    "asinh_amp",
    "ln_stdev",
    "ln_base",
    "ln_d_far",
    "dip_6_10",
    "ln_centre_share",
    "ln_misfit",
    "asinh_rise",
    "trace_7_9",
    "trace_12_16",
)
"""The features that pilot studies with realistic sensors settled on."""

THESIS_SIX = ("ln_base", "asinh_amp", "ln_stdev", "inv_curvature", "ln_d28", "dip_0_2")
FIELD_FEATURES = (
    *PILOT_FEATURES,
    "tilt_3_5",
    "tilt_6_9",
    "tilt_10_14",
    "dip_0_2",
    "dip_12_16",
    "ln_peak",
    "ln_width_near",
    "edge_far",
    "ln_width_far",
)
CUBIC = (
    "asinh_amp",
    "ln_stdev",
    "ln_d_far",
    "ln_force",
    "dip_6_10",
    "asinh_rise",
    "tilt_6_9",
    "dip_0_2",
    "ln_peak",
    "tilt_10_14",
    "trace_7_9",
)


@dataclass(frozen=True)
class Recipe:
    """Which features in which terms, and whether frames are moved to the mean force first.

    Attributes
    ----------
    degree : int
        All terms up to this degree.
    cubic : tuple of str
        Features whose products of three are tried as well.
    most_cubic : int or None
        How many of these to keep: the image must stay below 8000 bytes.
    """

    name: str
    features: tuple[str, ...]
    degree: int
    force_map: bool = True
    cubic: tuple[str, ...] = field(default=())
    most_cubic: int | None = None

    def candidates(self) -> tuple[Term, ...]:
        """All monomials up to `degree`, and of the features in `cubic` those of degree three."""
        terms = all_terms(len(self.features), self.degree)
        among = {self.features.index(name) for name in self.cubic}
        more = [t for t in all_terms(len(self.features), 3) if len(t) == 3 and set(t) <= among]
        return terms + tuple(t for t in more if t not in terms)

    def terms(self, z: Floats, Y: Floats, groups: NDArray[np.int64]) -> tuple[Term, ...]:
        """The terms to use, chosen on training strokes (see `most_cubic`).

        z : (n, features), standardised; Y : (n, outputs), link scale; groups : (n), which lump.
        """
        terms = self.candidates()
        plain = len(all_terms(len(self.features), self.degree))
        if self.most_cubic is None or len(terms) - plain <= self.most_cubic:
            return terms
        A, degrees = monomials(z, terms), [len(t) for t in terms]
        worth = importance(A, degrees, fit_ridge(A, Y, degrees, groups))[plain:]
        kept = np.sort(np.argsort(-worth, kind="stable")[: self.most_cubic])
        return terms[:plain] + tuple(terms[plain + k] for k in kept)

    @property
    def displacement(self) -> bool:
        """Whether it needs the displacement; without, the force map does without as well."""
        return any(name in OF_THE_DISPLACEMENT for name in self.features)

    def pressure_only(self) -> Recipe:
        """The same without displacement."""

        def keep(names: tuple[str, ...]) -> tuple[str, ...]:
            return tuple(n for n in names if n not in OF_THE_DISPLACEMENT)

        return Recipe(
            f"{self.name}, pressure only",
            keep(self.features),
            self.degree,
            self.force_map,
            keep(self.cubic),
            self.most_cubic,
        )


FIELD = Recipe("field", FIELD_FEATURES, 2, True, CUBIC, 48)
SIX_WITH_MAP = Recipe("thesis' six, force map", THESIS_SIX, 3)
SIX_BARE = Recipe("thesis' six", THESIS_SIX, 3, force_map=False)
PRESSURE_ONLY = FIELD.pressure_only()
"""For recordings without displacement."""
RECIPES = (FIELD, PRESSURE_ONLY, SIX_WITH_MAP, SIX_BARE)
