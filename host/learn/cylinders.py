"""`fit_to_cylinders`: from strokes over cylinders to a model, told its tissue or not.

The model is fitted to every lump. What is said of it comes from models that were fitted, both stages and the
intervals, without the lump in question (`study.held_out`), and from lumps outside the ranges and tissue
without lumps that none has seen.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from palpate.learn.anywhere import AnywhereStudy
from palpate.learn.checks import joined as checks_joined
from palpate.learn.data import Strokes
from palpate.learn.flags import NEAR, beyond
from palpate.learn.lumps import LumpStrokes
from palpate.learn.model import FittedModel, fit_model, force_map_in_any_fat, learn_force_map
from palpate.learn.observed import Observed, in_usual_tissue, joined, observe_in_any_fat
from palpate.learn.other_tissues import press_checks
from palpate.learn.reference import learn_joining
from palpate.learn.result import Judged, Taught, TissueFit, tissue_fit
from palpate.learn.scopes import BORDER, Scope
from palpate.learn.strange import StrangeStrokes, observe_strange, strange_checks, strange_table
from palpate.learn.study import FOLDS, Study
from palpate.model_export.integers import force_map as force_maps
from palpate.model_export.schema import FirstStage
from palpate.progress import ProgressCallback, Steps

DRAWS, USUAL_DRAWS, RIM_DRAWS, PLAIN_DRAWS = 3, 3, 2, 4
_RIM_SEED, _PLAIN_SEED = 600, 400
_RIM_TESTED = 3
"""Every third lump of the rim is kept to test the flag."""


def fit_to_cylinders(
    strokes: Strokes,
    noise: str = "typical",
    seed: int = 1,
    others: Sequence[str] = ("real",),
    progress: ProgressCallback | None = None,
    scope: Scope = BORDER,
) -> TissueFit:
    """Fit the model at one noise level, and the held-out table.

    Parameters
    ----------
    strokes : Strokes
        Of `data.prepare_strokes` with this scope.
    noise : str
        Level that the model is for, or a sensor's file.
    seed : int
        Of the sensors' noise.
    others : sequence of str
        Further levels, in the table only.
    progress : callable, optional
        See `progress.ProgressCallback`.
    scope : Scope
        What the model is for.
    """
    kind = AnywhereStudy if scope.layers else Study
    levels = (noise, *(other for other in others if other != noise))
    ways = (False, True) if scope.press else (False,)
    tell = Steps("observing and fitting", len(levels) * (len(ways) * FOLDS + DRAWS) + 4, progress)
    if scope.told:
        force_map = learn_force_map(strokes.lumps, scope.recipe.displacement)
    else:
        force_map = force_map_in_any_fat(strokes.lumps)
    blob = force_maps.blob(force_map)

    def observed(lumps: Sequence[LumpStrokes], level: str, first: int, draws: int) -> Iterator[Observed]:
        for draw in range(first, first + draws):
            yield observe_in_any_fat(lumps, level, _seed(seed, draw), blob, told=scope.told)

    rows = []
    for level in levels:
        seen = []
        for draw in observed(strokes.lumps, level, 0, DRAWS):
            seen.append(draw)
            tell("observed")
        # usual tissue counts twice: the far ends of the ranges would else take their share of the terms
        again = observed(strokes.lumps, level, DRAWS, USUAL_DRAWS)
        every = joined([*seen, *(more.take(in_usual_tissue(more)) for more in again)])
        rim, outside = _rim(joined(list(observed(strokes.rim, level, _RIM_SEED, RIM_DRAWS))), scope)
        for with_press in ways:
            study = kind.held_out(every, with_press, step=tell, rim=rim, scope=scope)
            rows.append(study.row(f"{level}, {study.scope.input}"))
        if level == noise:
            kept = seen[0], every, rim, outside, study
    first, every, rim, outside, study = kept
    model = replace(fit_model(scope, every, rim=rim), fat_kPa=strokes.lumps[0].case.fat_kPa)
    joining = None
    if model.press is not None:
        joining = learn_joining(model.press, first, strokes.lumps, strokes.references, noise, _seed(seed, 0))
    tell("model fitted")
    plain = joined(list(observed(strokes.plain, noise, _PLAIN_SEED, PLAIN_DRAWS)))
    tell("plain tissue")
    watch = StrangeStrokes(noise, seed, blob, scope.told)
    strange = observe_strange(watch, strokes.lumps, strokes.plain)
    checks = every_check(model, every, watch, strange, strokes)
    tell("checks fitted")
    became = strange_table(strokes.lumps, strokes.plain, every, rim, watch, strange, scope)
    tell("strange strokes")
    counts = {"lumps": len(np.unique(every.group)), "rim_lumps": len(np.unique(rim.group))}
    excluded = strokes.excluded | {"no lump found": int((~every.found).sum())}
    return tissue_fit(
        model,
        checks,
        joining,
        Taught((every, rim), counts, noise, seed, force_map),
        Judged(study, rows, became, every, outside, plain, excluded),
        layers=study.layers(model),
    )


def every_check(
    model: FittedModel,
    seen: Observed,
    watch: StrangeStrokes,
    strange: dict[str, Observed],
    strokes: Strokes,
) -> FirstStage:
    """What a model notices: strange strokes, and where it is told its tissue other ones.

    Parameters
    ----------
    model : FittedModel
    seen : Observed
        What it was fitted to.
    watch : StrangeStrokes
    strange : dict
        Of `observe_strange`.
    strokes : Strokes
        What it was fitted to, as simulated.
    """
    checks = strange_checks(model, seen, strange)
    if model.scope.told:
        checks = checks_joined(checks, press_checks(watch, strokes, seen, model.scope.recipe))
    return checks


def _seed(seed: int, draw: int) -> int:
    return 1000 * seed + draw


def _rim(seen: Observed, scope: Scope) -> tuple[Observed, Observed]:
    """Strokes over lumps outside the ranges: to train on, and to test the flag."""
    tested = seen.group % _RIM_TESTED == 0
    return seen.take(~tested & (beyond(seen, scope) < NEAR)), seen.take(tested)
