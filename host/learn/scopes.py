"""What a model is for, as data: ranges, features and terms, the press, the parts that intervals hold for.

Four scopes of one learner (`model.fit_model`): `TOLD` is told its tissue, `BORDER` is for lumps on the border
of fat and gland in tissue of all kinds, `ANYWHERE` for lumps in any layer, `SOLID` for balls and ellipsoids.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_py import outputs
from palpate.answer.layers import PLACES, layer_of, values
from palpate.features import press_features
from palpate.features.map_features import Floats
from palpate.learn.design import Tissue, lump_cases, no_lump_cases, other_cases, rim_cases
from palpate.learn.observed import FORCE_N_PER_M, OF_THE_DISPLACEMENT, Observed
from palpate.learn.probe_model import OUTPUTS, to_link
from palpate.learn.ridge import Term, all_terms, fit_ridge, importance
from palpate.model_export.integers.reference import monomials
from palpate.model_export.vocabulary import OF_THE_COLUMNS
from palpate.sim.tissue import Case
from palpate.sim.tissue.any_tissue import TissueRanges, plain_lumps, random_lumps, rim_lumps
from palpate.sim.tissue.anywhere import anywhere_lumps, anywhere_plain, anywhere_rim

Parts = dict[str, NDArray[np.bool_]]
"""Some of n strokes each, (n), by what they have in common."""

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
MOST_CUBIC = 40
"""Of a told model: the image must stay below 8000 bytes."""

ESTIMATES = ("ln_reach", "ln_t", "ln_layers")
"""Of the first stage: ln F/E_fat, ln t and ln(t + gland/ratio)."""
DEEPEST = "press_d_full"
"""Of the press, what the last stage has too: where there was no press it is outside the domain."""
LAST = (DEEPEST, "ln_force")
ALONE = "ln_d_far"
"""How deep the probe sinks, where there is no press to say it."""
PRESS = tuple(name for name in press_features.NAMES if name not in press_features.OUTER)
"""In plane strain the outer columns read what the others do."""
STROKE_TERMS = 200
"""So many that the board has room for both stages; 120 and 340 err by a fiftieth less."""

STROKE = (
    *("asinh_amp", "ln_stdev", "dip_6_10", "ln_misfit", "trace_7_9", "trace_12_16", "dip_12_16", "ln_peak"),
    *("ln_width_far", "ln_bump", "pull_3_5", "pull_6_9", "pull_10_14", "pull_15_19", "pull_20_24"),
    *("pull_25_33", "lift_3_5", "lift_17_22", "base_share"),
)
"""Of the stroke, what does not change when all moduli and the force do: the nineteen that were left when
the features worth least to held-out lumps on the border were dropped, two at a time."""
STROKE_ANYWHERE = (
    *("asinh_amp", "ln_stdev", "ln_centre_share", "ln_misfit", "asinh_rise", "trace_7_9", "trace_12_16"),
    *("tilt_3_5", "tilt_6_9", "dip_0_2", "dip_12_16", "ln_peak", "ln_width_near", "ln_width_far"),
    *("lift_0_2", "lift_7_9", "lift_12_16", "lift_17_22", "base_share"),
)
"""Found as `STROKE` was, on lumps anywhere."""
_LEFT_OUT = ("ln_force", "ln_base", "ln_d_far", "tilt_6_9", "dip_12_16")
STROKE_SOLID = (*(name for name in FIELD_FEATURES if name not in _LEFT_OUT), "base_share", *OF_THE_COLUMNS)
"""The features of the told model, but for what grows with moduli and force, and in place of the three worth
least how the bump is spread across. Those of its shape along the stroke bring nothing here: the noise is in
the narrow image of a ball, not in how it is put together."""


@dataclass(frozen=True)
class Recipe:
    """Which features in which terms.

    Attributes
    ----------
    degree : int
        All terms up to this degree.
    cubic : tuple of str
        Features whose products of three are tried as well.
    alone : tuple of str
        The last features, where they are multiplied by no other.
    most : int or None
        How many terms to keep.
    kept : int
        All terms up to this degree are among them.
    """

    name: str
    features: tuple[str, ...]
    degree: int
    cubic: tuple[str, ...] = field(default=())
    alone: tuple[str, ...] = field(default=())
    most: int | None = None
    kept: int = 2

    def candidates(self) -> tuple[Term, ...]:
        """All monomials up to `degree`, and of the features in `cubic` those of degree three."""
        free = [name for name in self.features if name not in self.alone]
        among = sorted(self.features.index(name) for name in self.cubic if name in free)
        terms = all_terms(len(free), self.degree)
        cubic = combinations_with_replacement(among, 3)
        return (*terms, *cubic, *((k,) for k in range(len(free), len(self.features))))

    def terms(self, z: Floats, Y: Floats, groups: NDArray[np.int64]) -> tuple[Term, ...]:
        """The terms to use, chosen on training strokes by what they are worth.

        z : (n, features), standardised; Y : (n, outputs), link scale; groups : (n), which lump.
        """
        return most_worth(self.candidates(), self.most, self.kept, z, Y, groups)

    @property
    def displacement(self) -> bool:
        """Whether it needs the displacement; without, the force map does without as well."""
        return any(name in OF_THE_DISPLACEMENT for name in self.features)


def most_worth(
    terms: tuple[Term, ...], most: int | None, kept: int, z: Floats, Y: Floats, groups: NDArray[np.int64]
) -> tuple[Term, ...]:
    """The `most` terms worth most, all up to the degree `kept` among them; else as `Recipe.terms`."""
    if most is None or len(terms) <= most:
        return terms
    A, degrees = monomials(z, terms), [len(t) for t in terms]
    y = (Y - Y.mean(0)) / Y.std(0)
    worth = importance(A, degrees, fit_ridge(A, y, degrees, groups))
    worth[np.array(degrees) <= kept] = np.inf
    return tuple(terms[k] for k in np.sort(np.argsort(-worth, kind="stable")[:most]))


def _told_recipe(name: str, displacement: bool) -> Recipe:
    features, cubic = (
        tuple(n for n in names if displacement or n not in OF_THE_DISPLACEMENT)
        for names in (FIELD_FEATURES, CUBIC)
    )
    most = len(all_terms(len(features), 2)) + MOST_CUBIC
    return Recipe(name, features, 2, cubic=cubic, most=most)


FIELD = _told_recipe("field", True)
PRESSURE_ONLY = _told_recipe("field, pressure only", False)
"""For recordings without displacement."""


Drawn = Callable[[int, int], list[Case]]
"""So many cases of a seed, at their middle force."""


@dataclass(frozen=True)
class Design:
    """What is simulated: lumps, those just outside the ranges, tissue without a lump; where the model is told
    its tissue, others too."""

    lumps: Drawn
    rim: Drawn
    plain: Drawn
    others: Drawn | None = None


@dataclass(frozen=True)
class Scope:
    """What a model is for.

    Attributes
    ----------
    ranges : mapping
        Of `OUTPUTS`, link scale; what lies beyond is outside the domain.
    recipe : Recipe
        Of the last stage; where the tissue is not told, of the stroke's features alone.
    quarters : tuple of str
        Truths by whose quarters the intervals are to hold.
    press : tuple of str
        The first stage's features; none: there is no first stage, the stroke has to say all.
    tissue : mapping, optional
        That of a model which is told its tissue and repeats E_fat, the last output: `design.Tissue`.
    ends : mapping
        Of estimates, link scale, by output; none: those of training.
    force_N_per_m : (float, float)
    folds : int
        Into how many parts lumps are divided to see estimates of lumps left out.
    layers : bool
        Whether lumps lie in several layers, which intervals are to hold for too.
    design : Design, optional
        What is simulated, of cylinders.
    targets : mapping
        Of one stroke, with its press where the scope has one, at typical noise: median errors, R2, hard or
        soft right, coverage in every quarter.
    words : mapping
        What the model's document says of the lumps.
    """

    ranges: Mapping[str, tuple[float, float]]
    recipe: Recipe
    quarters: tuple[str, ...]
    press: tuple[str, ...] = ()
    tissue: Mapping[str, Any] | None = None
    ends: Mapping[str, tuple[float, float]] | None = None
    force_N_per_m: tuple[float, float] = FORCE_N_PER_M
    folds: int = 4
    layers: bool = False
    design: Design | None = None
    targets: Mapping[str, float] = field(default_factory=dict)
    words: Mapping[str, str] = field(default_factory=lambda: {"tissue": "any"})

    @property
    def told(self) -> bool:
        """Whether the model is told its tissue."""
        return self.tissue is not None

    @property
    def estimated(self) -> int:
        """How many outputs are estimated."""
        return outputs.E_FAT if self.told else outputs.COUNT

    @property
    def input(self) -> str:
        """What the model is given, in words."""
        if self.told:
            return "one stroke"
        return "with its press" if self.press else "the stroke alone"

    @property
    def stroke_alone(self) -> Scope:
        """The scope without a press before the stroke."""
        return replace(self, press=())

    def of(self, recipe: Recipe) -> Scope:
        """The scope with these features and terms."""
        return replace(self, recipe=recipe)

    @property
    def last_stage(self) -> Recipe:
        """The recipe with the features that join the stroke's: of the press, or what stands in its place."""
        if self.told:
            return self.recipe
        names = self.recipe.features
        if self.press:
            names = (*names, *ESTIMATES, *LAST)
        else:
            names = (*names, *(name for name in (ALONE,) if name not in names), "ln_force")
        return replace(self.recipe, features=names, alone=tuple(name for name in names if name in LAST))

    def limits(self, name: str) -> tuple[float, float]:
        """The ends of an output's range; infinite where there is none."""
        return self.ranges.get(name, (-np.inf, np.inf))

    def parts(self, seen: Observed) -> Parts:
        """The parts of strokes that intervals hold for, each (n): quarters of truths, layers."""
        out: Parts = {}
        for name in self.quarters:
            true = seen.of(name)
            which = np.searchsorted(np.quantile(true, [0.25, 0.5, 0.75]), true, side="right")
            out |= {f"{name.removeprefix('ln ')}, quarter {k + 1}": which == k for k in range(4)}
        return out | (by_place(seen) if self.layers else {})


def true_place(seen: Observed) -> NDArray[np.int64]:
    """Where each lump lies, (n), of `answer.layers.PLACES`."""
    return layer_of(values(seen.truth, 0.0)[:, 0])


def by_place(seen: Observed) -> Parts:
    """The lumps of each layer, by name."""
    true = true_place(seen)
    return {words: true == k for k, words in enumerate(PLACES[:3])}


def _by_output(first: int, last: int) -> Mapping[str, tuple[float, float]]:
    """Two columns of the table of outputs, link scale, for a model that is told its tissue."""
    with np.errstate(divide="ignore"):
        low, high = (
            to_link(np.array([[row[k] for row in outputs.TABLE[: outputs.E_FAT]]], float))[0]
            for k in (first, last)
        )
    return {name: (float(a), float(b)) for name, a, b in zip(OUTPUTS, low, high)}


_TISSUES = ("ln d", "ln depth", "E^-2/3", "ln F", "ln E_fat", "gland_ratio", "gland_mm")
_BORDER_RANGES: dict[str, tuple[float, float]] = {
    "ln d": (float(np.log(5.0)), float(np.log(20.0))),
    "ln h": (float(np.log(0.3)), float(np.log(1.5))),
    "E^-2/3": (-np.inf, 2.0 ** (-2 / 3)),
    "ln E_fat": (float(np.log(2.0)), float(np.log(40.0))),
}
"""t follows from d and h, hard lumps feel alike, the force has a flag of its own."""


def _stroke(name: str, features: tuple[str, ...]) -> Recipe:
    cubic = (*CUBIC, "ln_bump", "pull_6_9", "pull_10_14", "base_share", *ESTIMATES)
    return Recipe(name, features, 2, cubic=cubic, most=STROKE_TERMS, kept=1)


def told(tissue: Tissue) -> Scope:
    """The scope of a model that is told its tissue."""
    drawn = (partial(of, tissue=tissue) for of in (lump_cases, rim_cases, no_lump_cases, other_cases))
    return Scope(
        _by_output(4, 5),
        FIELD,
        ("ln d", "ln h", "E^-2/3", "ln F"),
        tissue=tissue,
        ends=_by_output(6, 7),
        force_N_per_m=(outputs.TABLE[0][4], outputs.TABLE[0][5]),
        folds=8,
        design=Design(*drawn),
        targets={"d": 0.024, "t": 0.012, "h": 0.03, "hard_soft": 0.95, "worst_quarter": 0.86},
        words={},
    )


TOLD = told({})
"""Told that its tissue is the thesis'."""
BORDER = Scope(
    _BORDER_RANGES,
    _stroke("border", STROKE),
    _TISSUES,
    PRESS,
    design=Design(partial(random_lumps, r=TissueRanges()), rim_lumps, plain_lumps),
    targets={
        "d": 0.055,
        "depth": 0.03,
        "t": 0.025,
        "E_fat": 0.015,
        "d_r2": 0.94,
        "E_inv23_r2": 0.83,
        "hard_soft": 0.87,
        "worst_quarter": 0.86,
    },
)
"""Lumps on the border between fat and gland."""
ANYWHERE = Scope(
    _BORDER_RANGES
    | {
        "ln t": (float(np.log(4.0)), float(np.log(30.0))),
        "ln h": (float(np.log(2.0 / 20.0)), float(np.log(30.0 / 5.0))),
    },
    _stroke("anywhere", STROKE_ANYWHERE),
    _TISSUES,
    PRESS,
    layers=True,
    design=Design(anywhere_lumps, anywhere_rim, anywhere_plain),
    targets={"d": 0.116, "d_r2": 0.74, "depth": 0.066, "depth_r2": 0.94},
    words={"tissue": "any", "place": "any"},
)
"""The fat's thickness for itself; depth is no output, but h holds it roughly: 2 mm under the skin to 30.
Targets are of the laboratory, which had a reference press as well."""
SOLID = replace(
    BORDER,
    recipe=_stroke("solid", STROKE_SOLID),
    press=press_features.NAMES,
    design=None,
    targets={
        "d": 0.08,
        "width": 0.10,
        "depth": 0.05,
        "t": 0.03,
        "E_fat": 0.02,
        "hard_soft": 0.85,
        "worst_quarter": 0.86,
    },
    words={"tissue": "any", "shape": "solid"},
)
"""Balls and ellipsoids on the border."""
