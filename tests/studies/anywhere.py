"""How much is known of lumps that lie anywhere: each predicted without itself, beside a model of the tie."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from palpate.answer.layers import values
from palpate.features.map_features import Floats
from palpate.learn.anywhere import AnywhereStudy
from palpate.learn.data import SEED
from palpate.learn.lumps import LumpStrokes
from palpate.learn.model import FittedModel, fit_model, force_map_in_any_fat
from palpate.learn.probe_model import OUTPUTS
from palpate.learn.scopes import BORDER
from palpate.learn.study import TextTable
from palpate.learn.training import observed
from palpate.model_export.integers import force_map as force_maps
from palpate.progress import ProgressCallback
from palpate.sim.tissue import Case
from palpate.sim.tissue.anywhere import anywhere_lumps
from tests.studies import any_tissue
from tests.studies.bound import MEDIAN_OF_SD, Bound, computed_bound, simulate_neighbours
from tests.studies.table import Asked, StudyTable, of_text

DRAWS, TIED_LUMPS = 2, 400
BOUNDED, LEAST_BUMP = 24, 0.02
"""Lumps whose map's bound is worked out: the first that make such a bump, over the pressure far away."""

FALSE_FLAGS = 0.02
"""Share of tied lumps that the test for a broken tie may flag."""


def prepare(
    directory: Path, lumps: int, workers: int | None = None, progress: ProgressCallback | None = None
) -> tuple[list[LumpStrokes], list[LumpStrokes]]:
    """Simulate into `directory` what it lacks, and read it: lumps anywhere, and lumps on the border."""
    anywhere = any_tissue.simulated(directory, anywhere_lumps(lumps, SEED), workers, progress)
    return anywhere, any_tissue.prepare(directory / "tied", min(lumps, TIED_LUMPS), workers, progress)


def broken_tie(y: Floats) -> Floats:
    """How far t lies from d/2 + depth by what a model says, y (n, outputs), on a logarithmic scale (n)."""
    t, d, h = (np.exp(y[:, OUTPUTS.index(name)]) for name in ("ln t", "ln d", "ln h"))
    return np.abs(np.log(t / (d * (h + 0.5))))


def bounds(
    lumps: Sequence[LumpStrokes],
    directory: Path,
    noise: str = "typical",
    workers: int | None = None,
    progress: ProgressCallback | None = None,
) -> dict[int, Bound]:
    """What the map tells of the first `BOUNDED` visible lumps, by number; simulated if need be."""
    wanted: dict[int, Case] = {}
    for k, lump in enumerate(lumps):
        stroke = lump.strokes[len(lump.strokes) // 2]
        middle = stroke.images_kPa[:, 7:9].mean(1)
        if middle[-1] / middle[0] - 1 > LEAST_BUMP and len(wanted) < BOUNDED:
            wanted[k] = stroke.case
    found = simulate_neighbours(list(wanted.values()), directory / "information", workers, progress)
    known = {k: computed_bound(case, found, noise) for k, case in wanted.items()}
    return {k: bound for k, bound in known.items() if bound is not None}


def tables(asked: Asked) -> list[StudyTable]:
    """By place, what the map would allow, and what a model of the tie makes of such lumps."""
    noise = asked.noise or "typical"
    anywhere, tied = prepare(asked.directory, asked.lumps or any_tissue.LUMPS, progress=asked.progress)
    known = bounds(anywhere, asked.directory, noise, progress=asked.progress)
    blob = force_maps.blob(force_map_in_any_fat([*anywhere, *tied]))
    seen = observed(anywhere, noise, asked.seed, blob, draws=DRAWS)
    on_border = observed(tied, noise, asked.seed + 1, blob, draws=DRAWS)
    asked.tell("observed")
    found = AnywhereStudy.held_out(seen, step=asked.tell)
    of_tie = AnywhereStudy.held_out(on_border, step=asked.tell)
    model = fit_model(BORDER, on_border)
    texts = [*found.further_tables(), _bound(found, known), _of_the_tie(found, of_tie, model)]
    return [of_text(*text) for text in texts]


def _bound(found: AnywhereStudy, known: dict[int, Bound]) -> TextTable:
    """The map's bound beside the errors of the estimates, of the same lumps."""
    names = ("ln d", "ln depth", "ln fat_mm", "E^-2/3", "ln E_fat")
    of = np.isin(found.seen.group, list(known))
    y, _, true = found.told
    error = np.median(np.abs(y - true)[of], axis=0)
    c, _, both = found.combined(of)
    rows = [["estimates", *_percent(error[: len(names)]), *_percent([both]), f"{c:+.2f}"]]
    combined = [bound.combined() for bound in known.values()]
    middle = float(np.median([c for c, _ in combined]))
    for words, told in (("bound of the map", None), ("the same, told E", "E^-2/3"), ("told d", "ln d")):
        bounds = [b.told(told) if told else b for b in known.values()]
        sds = [float(np.median([MEDIAN_OF_SD * b.sd(name) for b in bounds])) for name in names]
        sums = [] if told else _percent([float(np.median([MEDIAN_OF_SD * sd for _, sd in combined]))])
        rows.append([words, *_percent(sds), *(sums or [""]), "" if told else f"{middle:+.2f}"])
    heads = ["", "d", "depth", "t", "E^-2/3 x 100", "E_fat", "ln d + c E^-2/3", "c"]
    return f"Median errors of {len(known)} lumps, %, and what the map itself allows", heads, rows


def _percent(values: Sequence[float] | Floats) -> list[str]:
    return [f"{100 * value:.2g}" for value in values]


def _of_the_tie(found: AnywhereStudy, of_tie: AnywhereStudy, model: FittedModel) -> TextTable:
    said, (_, _, true) = model.answer(found.seen), found.told
    limit = np.quantile(broken_tie(of_tie.y), 1 - FALSE_FLAGS)
    flagged = broken_tie(said.y) > limit
    d, t = (said.y[:, OUTPUTS.index(name)] for name in ("ln d", "ln t"))
    off = np.column_stack([d, values(said.y, 0.0)[:, 1], t]) - true[:, :3]
    half = said.half[:, OUTPUTS.index("ln d")]
    rows = []
    for words, of in found.groups().items():
        bias = [f"{100 * np.expm1(np.median(error)):+.0f} %" for error in off[of].T]
        size = np.abs(off[of][:, 0])
        inside = f"{100 * (size <= half[of]).mean():.0f}"
        rows.append(
            [
                words,
                f"{100 * np.expm1(np.median(size)):.0f} %",
                *bias,
                inside,
                f"{100 * flagged[of].mean():.0f} %",
            ]
        )
    c = of_tie.cells("", np.ones(len(of_tie.y), bool))
    title = (
        "A model taught that the border passes through the lump, on these strokes "
        f"(its own lumps: d {c[1]}, depth {c[2]}, t {c[3]}); flagged where t is not d/2 + depth, "
        f"as {100 * FALSE_FLAGS:.0f} % of its own are"
    )
    heads = ["lumps", "d off by", "d", "depth", "t", "d covered, %", "flagged"]
    return title, heads, rows
