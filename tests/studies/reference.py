"""What a reference press beside the lump is worth, and what one of another place or person does."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from palpate.features.map_features import Floats
from palpate.learn.data import SEED, sweep_progress
from palpate.learn.lumps import LumpStrokes
from palpate.learn.model import fit_model, force_map_in_any_fat, tissue_truth
from palpate.learn.observed import Observed, joined, observe_in_any_fat
from palpate.learn.reference import (
    References,
    Tissue,
    fit_joining,
    observe_references,
    out_of_fold_pairs,
    read_references,
    said_by,
    tissue_of,
)
from palpate.learn.scopes import BORDER
from palpate.learn.study import DRAWS, FOLDS, Study
from palpate.learn.study import text_of as outputs_text
from palpate.model_export.integers import force_map as force_maps
from palpate.model_export.vocabulary import ABSENT
from palpate.progress import ProgressCallback
from palpate.sim.tissue import Case, Stroke, sweep
from palpate.sim.tissue.any_tissue import (
    PRESS_PARTS,
    PRESSES,
    TissueRanges,
    at_forces,
    random_lumps,
    without_its_lump,
)
from tests.studies import any_tissue
from tests.studies.table import Asked, StudyTable

ELSEWHERE, ELSEWHERE_LUMPS = (0.1, 0.2), 300
"""How far off the fat's thickness is at other places; for so many lumps."""

PARTS = (*PRESS_PARTS, 1.4)
"""Forces of a reference, over the stroke's middle one."""
FAT_OFF = 1.3


@dataclass(frozen=True)
class Wrong:
    """References that do not belong to the strokes: what they are, and one for each stroke."""

    words: str
    references: References


def reference_cases(n: int, seed: int) -> list[Case]:
    """The tissues of `any_tissue.press_cases` without lumps, at the forces of a reference press."""
    lumps = random_lumps(n, seed, TissueRanges())
    return at_forces([without_its_lump(case) for case in lumps], PARTS)


def elsewhere_cases(n: int, seed: int, share: float) -> list[Case]:
    """Reference presses at other places: the fat is thicker or, at every other lump, thinner so."""
    lumps = enumerate(random_lumps(n, seed, TissueRanges()))
    return at_forces([without_its_lump(case, thicker(k, share)) for k, case in lumps], PARTS)


def thicker(k: int, share: float) -> float:
    """What the fat's thickness beside the k-th lump is times, in `elsewhere_cases`."""
    return (1.0 + share) ** (1 if k % 2 else -1)


def prepare(
    directory: Path, lumps: int, workers: int | None = None, progress: ProgressCallback | None = None
) -> list[LumpStrokes]:
    """As `any_tissue.prepare`, and presses beside these lumps and at other places."""
    report = sweep_progress("pressing beside", progress)
    sweep(reference_cases(lumps, SEED), PRESSES, directory / "reference", workers=workers, progress=report)
    for share in ELSEWHERE:
        cases = elsewhere_cases(min(lumps, ELSEWHERE_LUMPS), SEED, share)
        sweep(cases, PRESSES, _elsewhere(directory, share), workers=workers, progress=report)
    return any_tissue.prepare(directory, lumps, workers, progress)


def _elsewhere(directory: Path, share: float) -> Path:
    return directory / f"off{100 * share:.0f}"


def read_elsewhere(
    lumps: Sequence[LumpStrokes], home: Path, share: float
) -> dict[Tissue, tuple[Stroke, ...]]:
    """The presses of `elsewhere_cases`, by the tissue of the lump that they are not beside."""
    found, presses = {}, read_references(home)
    for k, lump in enumerate(lumps):
        own = tissue_of(lump.case)
        there = round(lump.case.t_mm * thicker(k, share), 6), *own[1:]
        if there in presses:
            found[own] = presses[there]
    return found


def up_to(n: int, references: References) -> References:
    """The references and behind them none, n in all."""
    more = n - len(references.press)
    return References(
        np.vstack([references.press, np.full((more, references.press.shape[1]), ABSENT)]),
        np.append(references.ln_force, np.zeros(more)),
    )


def table_of(
    directory: Path,
    lumps: Sequence[LumpStrokes],
    levels: Sequence[str] = ("typical",),
    draws: int = DRAWS,
    seed: int = 1,
    step: Callable[[str], None] | None = None,
) -> pd.DataFrame:
    """Rows as of `palpate fit`: with the press, with the reference, with wrong references."""
    blob = force_maps.blob(force_map_in_any_fat(lumps))
    found = read_references(directory / "reference")
    rows: list[dict[str, object]] = []
    for level in levels:
        seen, taken = [], []
        other: dict[float, list[References]] = {share: [] for share in ELSEWHERE}
        for k in range(draws):
            seen.append(observe_in_any_fat(lumps, level, 1000 * seed + k, blob))
            group = seen[-1].group
            taken.append(observe_references(lumps, found, level, 1000 * seed + k).take(group))
            for share in ELSEWHERE:
                some = lumps[:ELSEWHERE_LUMPS]
                there = read_elsewhere(some, _elsewhere(directory, share), share)
                observed = observe_references(some, there, level, 1000 * seed + k)
                other[share].append(up_to(len(lumps), observed).take(group))
        elsewhere = [
            Wrong(f"{100 * share:.0f} % thicker or thinner there", References.joined(parts))
            for share, parts in other.items()
        ]
        rows += rows_of(joined(seen), References.joined(taken), elsewhere, level, step)
    return pd.DataFrame(rows)


def rows_of(
    seen: Observed,
    references: References,
    elsewhere: Sequence[Wrong] = (),
    level: str = "typical",
    step: Callable[[str], None] | None = None,
) -> list[dict[str, object]]:
    """The table's rows of one level; strokes whose reference was refused are left out."""
    kept = references.taken
    seen, references = seen.take(kept), references.take(kept)
    another = np.random.default_rng(1).permutation(len(seen.group))
    stiffer = References(references.press, references.ln_force + np.log(FAT_OFF))
    wrong = [
        Wrong("of another person", references.take(another)),
        Wrong(f"of fat {FAT_OFF:g} times as stiff", stiffer),
        *(Wrong(w.words, w.references.take(kept)) for w in elsewhere),
    ]
    answers = held_out(seen, references, wrong, step=step)
    rows = []
    for words, (result, noticed) in answers.items():
        rows.append(result.row(f"{level}, {words}") | {"noticed": noticed})
    return rows


def held_out(
    seen: Observed,
    references: References,
    wrong: Sequence[Wrong] = (),
    folds: int = FOLDS,
    step: Callable[[str], None] | None = None,
) -> Mapping[str, tuple[Study, float]]:
    """By setting: answers of models that have not seen the lump, and the share of references left out.

    Of references that are wrong the answers are those of strokes where that was not noticed.
    """
    fold = seen.group % folds
    parts: dict[str, list[tuple[Observed, Floats, Floats, NDArray[np.bool_]]]] = {}
    fits: dict[str, list[NDArray[np.bool_]]] = {}

    def add(words: str, test: Observed, tissue: Floats, same: NDArray[np.bool_]) -> None:
        answer = model.answer(test, tissue)
        parts.setdefault(words, []).append((test, answer.y, answer.half, answer.hard))
        fits.setdefault(words, []).append(same)

    for k in range(folds):
        train = fold != k
        model = fit_model(BORDER, seen.take(train))
        pairs = out_of_fold_pairs(seen.take(train), references.take(train), model.press)
        joining = fit_joining(*pairs, tissue_truth(seen.take(train)))
        rows = np.flatnonzero(~train & seen.found)
        test, own = seen.take(rows), model.press.predict(seen.press[rows])
        add("with its press", test, own, np.ones(len(rows), bool))
        said = said_by(model.press, references.take(rows), test)
        add("with its press and a reference", test, joining.joined(own, said), joining.fits(own, said))
        for w in wrong:
            other = w.references.take(rows)
            there = np.flatnonzero(other.taken)
            said = said_by(model.press, other.take(there), test.take(there))
            same = joining.fits(own[there], said)
            missed = there[same]
            add(f"a reference {w.words}", test.take(missed),
                joining.joined(own[missed], said[same], always=True), same)  # fmt: skip
        if step:
            step(f"fold {k + 1} of {folds}")
    lost = float((~seen.found).mean())
    out = {}
    for words, found in parts.items():
        tests, y, half, hard = zip(*found)
        result = Study(joined(tests), np.concatenate(y), np.concatenate(half), np.concatenate(hard), lost)
        out[words] = result, 1 - float(np.concatenate(fits[words]).mean())
    return out


def text_of(result: pd.DataFrame) -> tuple[list[str], list[list[str]]]:
    """Heads and rows as of every such table, with the share of references that were left out."""
    heads, rows = outputs_text(result)
    noticed = ["", *(f"{100 * share:.1f} %" for share in result["noticed"])]
    return [*heads, "left out"], [[*row, share] for row, share in zip(rows, noticed)]


def tables(asked: Asked) -> list[StudyTable]:
    """What a reference is worth, the right one or a wrong one."""
    lumps = prepare(asked.directory, asked.lumps or any_tissue.LUMPS, progress=asked.progress)
    levels = (asked.noise or "typical",)
    found = table_of(asked.directory, lumps, levels, seed=asked.seed, step=asked.tell)
    return [StudyTable("A reference press beside the lump", *text_of(found), found)]
