"""`fit_in_any_tissue`: from a directory of strokes to the model that is not told its tissue.

The model is fitted to every lump. What is said of it comes from models that were fitted, both stages and the
intervals, without the lump in question (`study.held_out`), and from lumps outside the ranges and tissue
without lumps that none has seen.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from palpate.learn.any_tissue.data import TissueStrokes
from palpate.learn.any_tissue.flags import NEAR, beyond, facts_of
from palpate.learn.any_tissue.model import Scope, TissueModel, fit_tissue_model, tissue_truth
from palpate.learn.any_tissue.observed import (
    ObservedInTissue,
    TissueLump,
    in_usual_tissue,
    joined,
    observe,
)
from palpate.learn.any_tissue.reference import (
    Joining,
    fit_joining,
    observe_references,
    out_of_fold_pairs,
)
from palpate.learn.any_tissue.result import TissueFit
from palpate.learn.any_tissue.spec import tissue_spec
from palpate.learn.any_tissue.strange import (
    StrangeStrokes,
    observe_strange,
    strange_checks,
    strange_table,
)
from palpate.learn.any_tissue.study import FOLDS, TissueStudy, learnt_force_map
from palpate.learn.probe_model import training_hash
from palpate.model_export.fixed_point import force_map as force_maps
from palpate.progress import ProgressCallback, Steps

DRAWS, USUAL_DRAWS, RIM_DRAWS, PLAIN_DRAWS = 3, 3, 2, 4
_RIM_SEED, _PLAIN_SEED = 600, 400
_RIM_TESTED = 3
"""Every third lump of the rim is kept to test the flag."""


def fit_in_any_tissue(
    strokes: TissueStrokes,
    noise: str = "typical",
    seed: int = 1,
    others: Sequence[str] = ("real",),
    progress: ProgressCallback | None = None,
    kind: type[TissueStudy] = TissueStudy,
) -> TissueFit:
    """Fit the model at one noise level, and the held-out table.

    Parameters
    ----------
    strokes : TissueStrokes
        Of `data.prepare_strokes`.
    noise : str
        Level that the model is for, or a sensor's file.
    seed : int
        Of the sensors' noise.
    others : sequence of str
        Further levels, in the table only.
    progress : callable, optional
        See `progress.ProgressCallback`.
    kind : type of TissueStudy
        Says what the model is for, and judges it.
    """
    tell = Steps("observing and fitting", len((noise, *others)) * (2 * FOLDS + DRAWS) + 4, progress)
    force_map = learnt_force_map(strokes.lumps)
    blob = force_maps.blob(force_map)
    rows = []
    for level in (noise, *(other for other in others if other != noise)):
        seen = joined([_observed(strokes.lumps, level, seed, k, blob, tell) for k in range(DRAWS)])
        again = [observe(strokes.lumps, level, _seed(seed, DRAWS + k), blob) for k in range(USUAL_DRAWS)]
        # usual tissue counts twice: the far ends of the ranges would else take their share of the terms
        seen = joined([seen, *(more.take(in_usual_tissue(more)) for more in again)])
        rim, outside = _rim(strokes.rim, level, seed, blob, kind.scope)
        alone = kind.held_out(seen, False, step=tell, rim=rim)
        both = kind.held_out(seen, True, step=tell, rim=rim)
        rows += [alone.row(f"{level}, the stroke alone"), both.row(f"{level}, with its press")]
        if level == noise:
            kept = seen, rim, outside, both
    seen, rim, outside, study = kept
    model = fit_tissue_model(seen, True, rim, scope=kind.scope)
    joining = _joining(strokes, noise, seed, seen, model)
    tell("model fitted")
    plain = joined(
        [observe(strokes.plain, noise, _seed(seed, _PLAIN_SEED + k), blob) for k in range(PLAIN_DRAWS)]
    )
    tell("plain tissue")
    watch = StrangeStrokes(noise, seed, blob)
    strange = observe_strange(watch, strokes.lumps, strokes.plain)
    checks = strange_checks(model, seen, strange)
    tell("checks fitted")
    became = strange_table(strokes.lumps, strokes.plain, seen, rim, watch, strange, kind.scope)
    tell("strange strokes")
    spec = tissue_spec(
        model,
        joining,
        {
            "hash": training_hash(seen.X, seen.Y, rim.X, rim.Y),
            "n": int(seen.found.sum() + rim.found.sum()),
            "lumps": len(np.unique(seen.group)),
            "rim_lumps": len(np.unique(rim.group)),
            "noise": Path(noise).name,
            "seed": seed,
            "tissue": "any",
            **kind.training,
        },
        force_map.as_dict(),
        checks,
        layers=study.layers(model),
        held_out={k: v for k, v in rows[1].items() if isinstance(v, float)},
    )
    return TissueFit(
        spec=spec,
        model=model,
        noise=noise,
        rows=rows,
        study=study,
        strange=became,
        facts=facts_of(model, float(study.row("")["flagged"]), outside, plain, kind.scope),  # type: ignore[arg-type]
        excluded=strokes.excluded | {"no lump found": int((~seen.found).sum())},
        targets=kind.targets,
    )


def _seed(seed: int, draw: int) -> int:
    return 1000 * seed + draw


def _observed(
    lumps: Sequence[TissueLump], level: str, seed: int, draw: int, blob: bytes, tell: Callable[[str], None]
) -> ObservedInTissue:
    found = observe(lumps, level, _seed(seed, draw), blob)
    tell("observed")
    return found


def _joining(
    strokes: TissueStrokes, noise: str, seed: int, seen: ObservedInTissue, model: TissueModel
) -> Joining:
    """How a reference press joins the stroke's own, from tissues that the stage has not met."""
    first = seen.take(_first_draw(seen))
    found = observe_references(strokes.lumps, strokes.references, noise, _seed(seed, 0)).take(first.group)
    some, pressed = first.take(found.taken), found.take(found.taken)
    own, other = out_of_fold_pairs(some, pressed, model.press)
    return fit_joining(own, other, tissue_truth(some))


def _first_draw(seen: ObservedInTissue) -> np.ndarray:
    """Rows of the first draw, which come first and in the lumps' order."""
    ends = np.flatnonzero(np.diff(seen.group) < 0)
    return np.arange(len(seen.group)) <= (ends[0] if len(ends) else len(seen.group))


def _rim(
    lumps: Sequence[TissueLump], level: str, seed: int, blob: bytes, scope: Scope
) -> tuple[ObservedInTissue, ObservedInTissue]:
    """Strokes over lumps outside the ranges: to train on, and to test the flag."""
    seen = joined([observe(lumps, level, _seed(seed, _RIM_SEED + k), blob) for k in range(RIM_DRAWS)])
    tested = seen.group % _RIM_TESTED == 0
    return seen.take(~tested & (beyond(seen, scope) < NEAR)), seen.take(tested)
