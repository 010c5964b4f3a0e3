"""`fit_in_any_tissue`: from a directory of strokes to the model that is not told its tissue.

The model is fitted to every lump. What is said of it comes from models that were fitted, both stages and the
intervals, without the lump in question (`study.held_out`), and from lumps outside the ranges and tissue
without lumps that none has seen.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from palpate.learn.data import Strokes
from palpate.learn.flags import NEAR, beyond
from palpate.learn.lumps import LumpStrokes
from palpate.learn.model import fit_model, force_map_in_any_fat
from palpate.learn.observed import Observed, in_usual_tissue, joined, observe_in_any_fat
from palpate.learn.reference import learn_joining
from palpate.learn.result import TissueFit, tissue_fit
from palpate.learn.scopes import Scope
from palpate.learn.strange import StrangeStrokes, observe_strange, strange_checks, strange_table
from palpate.learn.study import FOLDS, Study
from palpate.model_export.integers import force_map as force_maps
from palpate.progress import ProgressCallback, Steps

DRAWS, USUAL_DRAWS, RIM_DRAWS, PLAIN_DRAWS = 3, 3, 2, 4
_RIM_SEED, _PLAIN_SEED = 600, 400
_RIM_TESTED = 3
"""Every third lump of the rim is kept to test the flag."""


def fit_in_any_tissue(
    strokes: Strokes,
    noise: str = "typical",
    seed: int = 1,
    others: Sequence[str] = ("real",),
    progress: ProgressCallback | None = None,
    kind: type[Study] = Study,
) -> TissueFit:
    """Fit the model at one noise level, and the held-out table.

    Parameters
    ----------
    strokes : Strokes
        Of `data.prepare_strokes`.
    noise : str
        Level that the model is for, or a sensor's file.
    seed : int
        Of the sensors' noise.
    others : sequence of str
        Further levels, in the table only.
    progress : callable, optional
        See `progress.ProgressCallback`.
    kind : type of Study
        Says what the model is for, and judges it.
    """
    tell = Steps("observing and fitting", len((noise, *others)) * (2 * FOLDS + DRAWS) + 4, progress)
    force_map, scope = force_map_in_any_fat(strokes.lumps), kind.scope
    blob = force_maps.blob(force_map)

    def observed(lumps: Sequence[LumpStrokes], level: str, first: int, draws: int) -> Iterator[Observed]:
        for draw in range(first, first + draws):
            yield observe_in_any_fat(lumps, level, _seed(seed, draw), blob)

    rows = []
    for level in (noise, *(other for other in others if other != noise)):
        seen = []
        for draw in observed(strokes.lumps, level, 0, DRAWS):
            seen.append(draw)
            tell("observed")
        first = seen[0]
        # usual tissue counts twice: the far ends of the ranges would else take their share of the terms
        again = observed(strokes.lumps, level, DRAWS, USUAL_DRAWS)
        every = joined([*seen, *(more.take(in_usual_tissue(more)) for more in again)])
        rim, outside = _rim(joined(list(observed(strokes.rim, level, _RIM_SEED, RIM_DRAWS))), scope)
        alone = kind.held_out(every, False, step=tell, rim=rim)
        both = kind.held_out(every, True, step=tell, rim=rim)
        rows += [alone.row(f"{level}, the stroke alone"), both.row(f"{level}, with its press")]
        if level == noise:
            kept = first, every, rim, outside, both
    first, every, rim, outside, study = kept
    model = fit_model(scope, every, rim=rim)
    assert model.press is not None
    joining = learn_joining(model.press, first, strokes.lumps, strokes.references, noise, _seed(seed, 0))
    tell("model fitted")
    plain = joined(list(observed(strokes.plain, noise, _PLAIN_SEED, PLAIN_DRAWS)))
    tell("plain tissue")
    watch = StrangeStrokes(noise, seed, blob)
    strange = observe_strange(watch, strokes.lumps, strokes.plain)
    checks = strange_checks(model, every, strange)
    tell("checks fitted")
    became = strange_table(strokes.lumps, strokes.plain, every, rim, watch, strange, scope)
    tell("strange strokes")
    return tissue_fit(
        model,
        joining,
        checks,
        (every, rim),
        {"lumps": len(np.unique(every.group)), "rim_lumps": len(np.unique(rim.group))},
        noise,
        seed,
        study,
        rows,
        force_map,
        became,
        outside,
        plain,
        strokes.excluded | {"no lump found": int((~every.found).sum())},
        layers=study.layers(model),
    )


def _seed(seed: int, draw: int) -> int:
    return 1000 * seed + draw


def _rim(seen: Observed, scope: Scope) -> tuple[Observed, Observed]:
    """Strokes over lumps outside the ranges: to train on, and to test the flag."""
    tested = seen.group % _RIM_TESTED == 0
    return seen.take(~tested & (beyond(seen, scope) < NEAR)), seen.take(tested)
