"""How much is known of lumps that lie anywhere: each predicted without itself, beside a model of the tie."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.features.map_features import Floats
from palpate.regression.any_tissue import study as any_tissue
from palpate.regression.any_tissue.observed import ObservedInTissue, TissueLump, joined, observe, read_set
from palpate.regression.anywhere.information import Information, information, simulate_neighbours
from palpate.regression.anywhere.model import (
    BORDER,
    FAT,
    GLAND,
    OUTPUTS,
    PLACES,
    SHARE,
    STIFFNESS,
    AnywhereAnswers,
    AnywhereModel,
    fit_anywhere,
    true_place,
    truth,
)
from palpate.regression.field.data import sweep_progress
from palpate.regression.probe_model import HARD_BELOW
from palpate.regression.progress import ProgressCallback
from palpate.regression.table import r_squared
from palpate.sim.tissue import Case, sweep
from palpate.sim.tissue.any_tissue import PRESSES, STROKES
from palpate.sim.tissue.anywhere import anywhere_cases, anywhere_press_cases

SEED, DRAWS, FOLDS, TIED_LUMPS = 31, 2, 5, 400
_D, _DEPTH, _T = (OUTPUTS.index(name) for name in ("ln d", "ln depth", "ln t"))
BOUNDED, LEAST_BUMP = 24, 0.02
"""Lumps whose map's bound is worked out: the first that make such a bump, over the pressure far away."""

MEDIAN_OF_SD = 0.6745
FALSE_FLAGS = 0.02
"""Share of tied lumps that the test for a broken tie may flag."""

Step = Callable[[str], None]


def prepare(
    directory: Path, lumps: int, workers: int | None = None, progress: ProgressCallback | None = None
) -> tuple[list[TissueLump], list[TissueLump]]:
    """Simulate into `directory` what it lacks, and read it: lumps anywhere, and lumps on the border."""
    presses, strokes = directory / "press", directory / "lumps"
    report = sweep_progress("pressing", progress)
    sweep(anywhere_press_cases(lumps, SEED), PRESSES, presses, workers=workers, progress=report)
    report = sweep_progress("stroking", progress)
    sweep(anywhere_cases(lumps, SEED), STROKES, strokes, workers=workers, progress=report)
    tied = any_tissue.prepare(directory / "tied", min(lumps, TIED_LUMPS), workers, progress)
    return read_set(strokes, presses), tied


@dataclass(frozen=True)
class AnywhereStudy:
    """Strokes that found a lump, and what is said of them by models that have not seen the lump."""

    seen: ObservedInTissue
    said: AnywhereAnswers
    lost: float

    def row(self, words: str, of: NDArray[np.bool_]) -> list[str]:
        """R2 / median error / coverage of every output, and hard or soft right, of some strokes (n)."""
        Y, y, half = truth(self.seen)[of], self.said.y[of], self.said.half[of]
        cells = []
        for j in range(len(OUTPUTS)):
            error = np.abs(y[:, j] - Y[:, j])
            absolute = j in (STIFFNESS, SHARE)
            size = f"{np.median(error):.3f}" if absolute else f"{100 * np.expm1(np.median(error)):.1f} %"
            covered = (error <= half[:, j]).mean()
            cells.append(f"{r_squared(Y[:, j], y[:, j]):.2f} / {size} / {100 * covered:.0f}")
        right = (self.said.hard[of] == (Y[:, STIFFNESS] <= HARD_BELOW)).mean()
        return [words, *cells, f"{100 * right:.0f}", str(len(np.unique(self.seen.group[of])))]

    def combined(self, of: NDArray[np.bool_]) -> tuple[float, float, float]:
        """c, and the median errors of ln d alone and of ln d + c E^-2/3, whose errors have least spread."""
        r = (self.said.y - truth(self.seen))[of][:, [_D, STIFFNESS]]
        cov = np.cov(r.T)
        c = -cov[0, 1] / cov[1, 1]
        return float(c), float(np.median(np.abs(r[:, 0]))), float(np.median(np.abs(r @ [1.0, c])))


def held_out(seen: ObservedInTissue, folds: int = FOLDS, step: Step | None = None) -> AnywhereStudy:
    """Every lump predicted by models fitted, both stages and the intervals, without it."""
    fold = seen.group % folds
    parts, answers = [], []
    for k in range(folds):
        test = seen.take((fold == k) & seen.found)
        parts.append(test)
        answers.append(fit_anywhere(seen.take(fold != k)).answer(test))
        if step:
            step(f"fold {k + 1} of {folds}")
    said = AnywhereAnswers(
        np.concatenate([a.y for a in answers]),
        np.concatenate([a.half for a in answers]),
        np.concatenate([a.hard for a in answers]),
    )
    return AnywhereStudy(joined(parts), said, float((~seen.found).mean()))


def seen_by_the_probe(lumps: Sequence[TissueLump], blob: bytes, seed: int, noise: str) -> ObservedInTissue:
    """Some strokes over each lump, through the probe's integers."""
    return joined([observe(lumps, noise, 1000 * seed + k, blob) for k in range(DRAWS)])


def broken_tie(said: AnywhereAnswers) -> Floats:
    """How far t lies from d/2 + depth by what a model says, on a logarithmic scale (n)."""
    d, depth, t = (np.exp(said.y[:, j]) for j in (_D, _DEPTH, _T))
    return np.abs(np.log(t / (d / 2 + depth)))


@dataclass(frozen=True)
class AnywhereTables:
    """The study's tables, each a title, heads and rows."""

    tables: tuple[tuple[str, list[str], list[list[str]]], ...]

    def to_dict(self) -> list[dict[str, object]]:
        """The same for JSON."""
        return [
            {"title": t, "rows": [dict(zip(heads, row)) for row in rows]} for t, heads, rows in self.tables
        ]


def bounds(
    lumps: Sequence[TissueLump],
    directory: Path,
    noise: str = "typical",
    workers: int | None = None,
    progress: ProgressCallback | None = None,
) -> dict[int, Information]:
    """What the map tells of the first `BOUNDED` visible lumps, by number; simulated if need be."""
    wanted: dict[int, Case] = {}
    for k, lump in enumerate(lumps):
        stroke = lump.strokes.strokes[len(lump.strokes.strokes) // 2]
        middle = stroke.images_kPa[:, 7:9].mean(1)
        if middle[-1] / middle[0] - 1 > LEAST_BUMP and len(wanted) < BOUNDED:
            wanted[k] = stroke.case
    found = simulate_neighbours(list(wanted.values()), directory / "information", workers, progress)
    known = {k: information(case, found, noise) for k, case in wanted.items()}
    return {k: bound for k, bound in known.items() if bound is not None}


def study(
    anywhere: Sequence[TissueLump],
    tied: Sequence[TissueLump],
    known: dict[int, Information],
    noise: str = "typical",
    seed: int = 1,
    step: Step | None = None,
) -> AnywhereTables:
    """Everything that `palpate study anywhere` prints; `known` as `bounds` gives it."""
    blob = any_tissue.force_map_of([*anywhere, *tied])
    seen = seen_by_the_probe(anywhere, blob, seed, noise)
    on_border = seen_by_the_probe(tied, blob, seed + 1, noise)
    if step:
        step("observed")
    return tables_of(seen, on_border, known, step)


def tables_of(
    seen: ObservedInTissue,
    on_border: ObservedInTissue,
    known: dict[int, Information],
    step: Step | None = None,
) -> AnywhereTables:
    """The tables of strokes over lumps anywhere, and over lumps on the border to teach the tie."""
    found = held_out(seen, step=step)
    of_tie = held_out(on_border, step=step)
    model = fit_anywhere(on_border)
    return AnywhereTables(
        (
            _estimates(found),
            _places(found),
            _told_apart(found),
            _bound(found, known),
            _of_the_tie(found, of_tie, model),
        )
    )


def _parts(found: AnywhereStudy) -> dict[str, NDArray[np.bool_]]:
    place, Y = true_place(found.seen), truth(found.seen)
    hard = Y[:, STIFFNESS] <= HARD_BELOW
    depth = np.exp(Y[:, _DEPTH])
    return {
        "all": np.ones(len(Y), bool),
        **{PLACES[k]: place == k for k in (FAT, BORDER, GLAND)},
        "hard": hard,
        "soft": ~hard,
        "less than 6 mm deep": depth < 6,
        "hard and less than 6 mm deep": hard & (depth < 6),
    }


def _estimates(found: AnywhereStudy) -> tuple[str, list[str], list[list[str]]]:
    rows = [found.row(words, of) for words, of in _parts(found).items() if of.sum() > 1]
    title = (
        "Lumps anywhere, held out: R2 / median error / coverage of 90 % intervals; "
        f"{100 * found.lost:.0f} % of strokes find no lump"
    )
    return title, ["lumps", *OUTPUTS, "hard/soft", "n"], rows


def _places(found: AnywhereStudy) -> tuple[str, list[str], list[list[str]]]:
    true, said = true_place(found.seen), found.said.place
    rows = []
    for k in (FAT, BORDER, GLAND):
        rows.append(
            [PLACES[k], *(f"{100 * (said[true == k] == j).mean():.0f} %" for j in range(len(PLACES)))]
        )
    told = said < len(PLACES) - 1
    rows.append(["right where it is said", f"{100 * (said == true)[told].mean():.0f} %", "", "", ""])
    return "Where the lump lies (rows), and where it is said to lie", ["place", *PLACES], rows


def _told_apart(found: AnywhereStudy) -> tuple[str, list[str], list[list[str]]]:
    rows = []
    for words, of in _parts(found).items():
        if of.sum() > 2:
            c, alone, both = found.combined(of)
            rows.append(
                [words, f"{100 * np.expm1(alone):.1f} %", f"{c:+.2f}", f"{100 * np.expm1(both):.1f} %"]
            )
    return (
        "Size and stiffness: the combination that is known, ln d + c E^-2/3",
        ["lumps", "median error of d", "c", "of the combination"],
        rows,
    )


def _bound(found: AnywhereStudy, known: dict[int, Information]) -> tuple[str, list[str], list[list[str]]]:
    """The map's bound beside the errors of the estimates, of the same lumps."""
    names = ("ln d", "ln depth", "ln fat_mm", "E^-2/3", "ln E_fat")
    of = np.isin(found.seen.group, list(known))
    error = np.median(np.abs(found.said.y - truth(found.seen))[of], axis=0)
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


def _of_the_tie(
    found: AnywhereStudy, of_tie: AnywhereStudy, model: AnywhereModel
) -> tuple[str, list[str], list[list[str]]]:
    said, Y = model.answer(found.seen), truth(found.seen)
    limit = np.quantile(broken_tie(of_tie.said), 1 - FALSE_FLAGS)
    flagged = broken_tie(said) > limit
    rows = []
    for words, of in _parts(found).items():
        error = (said.y - Y)[of]
        bias = [f"{100 * np.expm1(np.median(error[:, j])):+.0f} %" for j in (_D, _DEPTH, _T)]
        size = f"{100 * np.expm1(np.median(np.abs(error[:, _D]))):.0f} %"
        inside = f"{100 * (np.abs(error[:, _D]) <= said.half[of][:, _D]).mean():.0f}"
        rows.append([words, size, *bias, inside, f"{100 * flagged[of].mean():.0f} %"])
    c = of_tie.row("", np.ones(len(of_tie.said.y), bool))
    title = (
        "A model taught that the border passes through the lump, on these strokes "
        f"(its own lumps: d {c[1]}, depth {c[2]}, t {c[3]}); flagged where t is not d/2 + depth, "
        f"as {100 * FALSE_FLAGS:.0f} % of its own are"
    )
    heads = ["lumps", "d off by", "d", "depth", "t", "d covered, %", "flagged"]
    return title, heads, rows
