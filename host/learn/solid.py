"""`fit_to_balls`: from a set of computed strokes over balls and ellipsoids to a model of solid lumps.

The model is fitted to all computed strokes, and to others that an emulator makes from them. What is said of
it, and how wide its intervals are, comes from computed lumps that neither had met (`training.held_out_fold`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from palpate import models
from palpate.learn.across import across_of, fit_place
from palpate.learn.emulator import fit_emulator
from palpate.learn.lumps import LumpStrokes, without_lump
from palpate.learn.model import force_map_in_any_fat
from palpate.learn.probe_model import E_INV23, to_link
from palpate.learn.reference import learn_joining, tissue_of
from palpate.learn.result import Judged, Taught, TissueFit, tissue_fit
from palpate.learn.strange import StrangeStrokes, observe_strange, strange_checks, strange_rows
from palpate.learn.training import (
    EMULATED,
    EMULATED_SEED,
    FOLDS,
    SolidStudy,
    Studies,
    across_factor,
    emulated_seed,
    held_out_fold,
    judged,
    observed,
    taught,
    train,
    widened,
    width_factors,
)
from palpate.model_export.integers import force_map as force_maps
from palpate.model_export.integers.reference import evaluate, inputs
from palpate.progress import ProgressCallback, Steps
from palpate.sim.tissue.solid.design import COVERED, ball_cases
from palpate.sim.tissue.workers import pool

_REFERRED = 1000
"""Emulated lumps with a reference press beside them, or with a second lump."""

_PLAIN = 300
"""Of these, how many times without the lump, for tissue that undulates."""


def fit_to_balls(
    lumps: Sequence[LumpStrokes],
    noise: str = "typical",
    seed: int = 1,
    others: Sequence[str] = ("real",),
    workers: int = 1,
    progress: ProgressCallback | None = None,
    count: int = EMULATED,
    rim: Sequence[LumpStrokes] = (),
) -> TissueFit:
    """Fit the model at one noise level, and the held-out table.

    Parameters
    ----------
    lumps : sequence of LumpStrokes
        Of `lumps.prepare`.
    noise : str
        Level that the model is for, or a sensor's file.
    seed : int
        Of the sensors' noise.
    others : sequence of str
        Further levels, in the table only.
    workers : int
        Processes.
    progress : callable, optional
        See `progress.ProgressCallback`.
    count : int
        Emulated lumps.
    rim : sequence of LumpStrokes, optional
        Lumps outside the ranges (`lumps.read_rim`), to test the flag; nothing is fitted to them.
    """
    levels = (noise, *(other for other in others if other != noise))
    tell = Steps("emulating and fitting", FOLDS + len(levels) + 3, progress)
    force_map = force_map_in_any_fat(lumps)
    blob = force_maps.blob(force_map)
    left_out_of = partial(held_out_fold, lumps, levels=levels, seed=seed, force_map=blob, count=count)
    folds: list[Studies] = []
    with pool(min(workers, FOLDS), __name__) as processes:
        for fold in processes.map(left_out_of, range(FOLDS)):
            folds.append(fold)
            tell(f"{len(folds)} of {FOLDS} folds")
    rows: list[dict[str, object]] = []
    studies = {key: judged([fold[key] for fold in folds]) for key in folds[0]}
    for level in levels:
        for with_press, words in ((False, "the stroke alone"), (True, "with its press")):
            rows.append(studies[level, with_press].row(f"{level}, {words}"))
        rows.append(plane_study(lumps, level, seed).row(f"{level}, plane-strain model"))
        tell("plane-strain model asked")
    study = studies[noise, True]
    emulator = fit_emulator(lumps)
    seen = taught(emulator, lumps, noise, seed, blob, count)
    tell("emulated")
    trained = train(seen)
    left_out = [fold[noise, True] for fold in folds]
    model = widened(trained.model, width_factors(left_out))
    width, place = trained.width.wider(across_factor(left_out)), fit_place([part.seen for part in left_out])
    some = emulator.lumps(ball_cases(count, EMULATED_SEED, COVERED)[: 3 * _REFERRED])
    # the press where a stroke begins, well off the lump, stands for one beside it
    references = {tissue_of(lump.case): lump.press for lump in some}
    first = seen.take(seen.group < len(some))
    assert model.press is not None
    joining = learn_joining(model.press, first, some, references, noise, emulated_seed(seed))
    watch = StrangeStrokes(noise, seed, blob)
    checks = strange_checks(
        model, seen, observe_strange(watch, some, [without_lump(lump) for lump in some[:_PLAIN]])
    )
    tell("model fitted")
    plain = [without_lump(lump) for lump in lumps]
    own = observed(lumps, noise, seed, blob, draws=1)
    strange = strange_rows(replace(model, checks=checks), own, lumps, plain, watch)
    tell("strange strokes")
    outside = observed(rim, noise, seed, blob, len(lumps)) if rim else None
    unmet = observed(plain, noise, seed, blob, draws=1)
    excluded = {"no lump found": round(len(study.y) * study.lost / (1 - study.lost))}
    return tissue_fit(
        model,
        checks,
        joining,
        Taught((seen,), {"lumps": len(lumps), "emulated_lumps": count}, noise, seed, force_map),
        Judged(study, rows, strange, own, outside, unmet, excluded),
        across=None if place is None else across_of(width, place),
    )


def plane_study(lumps: Sequence[LumpStrokes], noise: str, seed: int) -> SolidStudy:
    """What the model of endless cylinders that comes with Palpate says of the same lumps."""
    spec = models.load(models.FIELD)
    seen = observed(lumps, noise, seed, b"" if spec.force_map is None else force_maps.blob(spec.force_map))
    found = seen.take(seen.found)
    said = evaluate(spec, inputs(spec, found.X))
    y, low, high = (to_link(said[part]) for part in ("value", "low", "high"))
    hard = np.asarray(said["value"])[:, E_INV23] < spec.hard_below
    lost = float((~seen.found).mean())
    return SolidStudy(found, y, (high - low) / 2, hard, lost, np.asarray(said["in_domain"]))
