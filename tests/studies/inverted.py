"""Strokes fitted by the forward model: how far off, and how often the intervals hold.

Lumps anywhere that no model has seen, each stroked once: computed on a mesh that the inversion does not use,
every frame at its own place and force, then felt by a probe of that noise. What is done is kept in
DIRECTORY/inverted.jsonl; a study that was ended goes on where it stopped.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.answer.fitted import HARD, LEVEL
from palpate.errors import PalpateError
from palpate.inversion.classes import ANYWHERE, BORDER
from palpate.inversion.felt import FeltStroke
from palpate.inversion.result import FITS
from palpate.inversion.start import Start
from palpate.inversion.strokes import invert_stroke
from palpate.inversion.widening import NORMAL, WIDER
from palpate.learn.conformal import quantile_of_part
from palpate.learn.observed import random_scale
from palpate.sim.probe.noise import level_named
from palpate.sim.probe.packed_frames import Truth
from palpate.sim.tissue import Case
from palpate.sim.tissue.any_tissue import TissueRanges, random_lumps
from palpate.sim.tissue.anywhere import anywhere_lumps
from tests.host.inversion.world import felt_of, in_fat_of
from tests.studies.table import Asked, StudyTable, kept_rows, of_text

LUMPS = 300
_HALF_OF_ALL = 0.6745
"""So many standard deviations half the errors would be below."""
WORDS = {"d_mm": "ln d", "depth_mm": "ln depth", "t_mm": "ln t", "E_inv23": "E^-2/3", "E_fat_kPa": "ln_E"}
"""What is judged, and what widens it."""

PLACED = {ANYWHERE.name: "anywhere", BORDER.name: "on the border"}


def lumps(n: int, seed: int, of: str = ANYWHERE.name) -> list[Case]:
    """`n` lumps of a class in fat of 2 to 40 kPa; the first of more are the same."""
    rng = np.random.default_rng(seed)
    if of == BORDER.name:
        drawn = random_lumps(n, 9000 + seed, TissueRanges())
    else:
        drawn = anywhere_lumps(n, 9000 + seed)
    return [in_fat_of(case, case.fat_kPa * random_scale(case, rng)) for case in drawn]


def tables(asked: Asked, of: str = ANYWHERE.name) -> list[StudyTable]:
    """Invert what is not yet there; then accuracy, and factors from one half for the other."""
    cases = lumps(asked.lumps or LUMPS, asked.seed, of)
    noise, seed = asked.noise or "typical", 1000 * asked.seed
    rows = kept_rows(asked, "inverted.jsonl", len(cases), lambda k: inverted(cases[k], seed + k, noise, of))
    return judged(rows, of)


def inverted(case: Case, seed: int, noise: str, of: str) -> dict[str, Any]:
    """One stroke: how far regression and inversion are off, and how far the posterior spreads that way."""
    try:
        felt, start, stream, _ = felt_of(case, seed, noise)
    except PalpateError as error:  # no such tissue, no equilibrium, or a stroke that cannot be inverted
        return {"code": case.code, "problem": str(error)}
    return fitted(felt, start, stream.truth, noise, of)


def fitted(felt: FeltStroke, start: Start, under: Truth, noise: str, of: str) -> dict[str, Any]:
    """A stroke's row, fitted under a class of this name."""
    begun = time.process_time()
    found = invert_stroke(felt, start, level_named(noise), of)
    took = time.process_time() - begun
    row: dict[str, Any] = {"code": under.case.code, "cpu_s": took, "problem": found.problem}
    if found.problem or not found.lump:
        return row | {"problem": found.problem or "told as no lump"}
    first, truths = said_first(start), truths_of(under)
    for name, factor in WORDS.items():
        value, truth = found.values[name], truths[name]
        assert value.high is not None
        scale = scale_of(name)
        below, above = scale(value.value) - scale(value.low), scale(value.high) - scale(value.value)
        apart, before = (scale(each) - scale(truth) for each in (value.value, first[name]))
        half = below if apart > 0 else above  # towards the truth
        row[name] = {"apart": apart, "sd": WIDER[factor].sd(half, found.settled)}
        row[name] |= {"first": before, "truth": truth}
    said = found.hardness
    hard = under.case.E_inv23 < HARD
    right = None if said == "unsure" else (said == "hard") == hard
    more_likely = (found.values["E_inv23"].value < HARD) == hard
    return row | {"chi2": found.chi2, "settled": found.settled, "right": right, "likely": more_likely}


def scale_of(name: str) -> Callable[[float], float]:
    """What errors are differences of: E^-2/3 itself, of all else the logarithm."""
    return float if name == "E_inv23" else math.log


def truths_of(under: Truth) -> dict[str, float]:
    """What was under the probe, by what is judged: the fat as stiff as it was there."""
    return {name: getattr(under.case, name) for name in WORDS} | {"E_fat_kPa": under.fat_kPa}


def said_first(start: Start) -> dict[str, float]:
    """What the regression said, by what is judged."""
    return {
        "d_mm": start.d_mm, "depth_mm": start.depth_mm, "t_mm": start.t_mm, "E_inv23": start.E_inv23,
        "E_fat_kPa": start.E_kPa,
    }  # fmt: skip


def judged(rows: list[dict[str, Any]], of: str) -> list[StudyTable]:
    """Errors and intervals of the rows, and factors; held out by halves."""
    whole = [row for row in rows if not row["problem"]]
    fits = np.array([row["chi2"] < FITS for row in whole])
    settled = np.array([row["settled"] for row in whole], bool)
    out, factors = [], []
    for name, factor in WORDS.items():
        wider = WIDER[factor]
        apart, sd, first, truth = (
            np.array([row[name][key] for row in whole]) for key in ("apart", "sd", "first", "truth")
        )
        half = np.array([wider.half(*pair) for pair in zip(sd, settled, strict=True)])
        held = np.abs(apart) <= half
        out.append([
            name, *(f"{100 * np.median(np.abs(e)):.1f}" for e in (first, apart, apart[fits])),
            f"{100 * _HALF_OF_ALL * np.median(sd):.1f}", f"{100 * np.median(half[fits]):.1f}",
            *(f"{100 * part.mean():.0f}" for part in (held[fits], held)),
            *(f"{100 * worst_quarter(held[fits], by[fits]):.0f}" for by in (truth, half)),
        ])  # fmt: skip
        asked = np.sqrt(np.maximum(apart**2 - wider.floor**2, 0.0)) / (NORMAL * sd)
        for words, part, used in (
            ("settled", settled, wider.settled),
            ("did not settle", ~settled, wider.restless),
        ):
            these = asked[fits & part]
            if not len(these):
                continue
            factors.append([
                f"{name}, {words}", str(len(these)), f"{np.quantile(these, LEVEL):.2f}", f"{used:.2f}",
                f"{wider.floor:.3f}", f"{100 * halves_crossed(these):.0f}",
            ])  # fmt: skip
    told = [row["right"] for row in whole if row["right"] is not None]
    fit, rest, likely, some, right = (
        f"{100 * np.mean(share):.0f} %"
        for share in (
            fits,
            settled,
            [row["likely"] for row in whole],
            [row["right"] is not None for row in whole],
            told or [0.0],
        )
    )
    title = (
        f"{len(rows)} strokes over lumps {PLACED[of]}: {len(rows) - len(whole)} not inverted, {fit} fit, "
        f"{rest} settled; {likely} nearer to hard or soft, rightly, told in {some}, {right} of it right; "
        f"{np.median([row['cpu_s'] for row in whole]):.1f} CPU s in the median"
    )
    heads = ["", "regression", "inversion", "those that fit", "allowed", "half-width", "held", "held, all",
             "worst quarter", "of widths"]  # fmt: skip
    return [
        of_text(title, heads, out),
        of_text(
            "What widens intervals",
            ["", "strokes", "asked", "used", "floor", "held, halves crossed"],
            factors,
        ),
    ]


def halves_crossed(asked: NDArray[np.float64]) -> float:
    """The share of factors asked for (n) that the other half's quantile would give."""
    half = np.arange(len(asked)) % 2
    factors = np.array([quantile_of_part(asked, half != k, LEVEL) for k in (0, 1)])
    return float((asked <= factors[half]).mean())


def worst_quarter(held: NDArray[np.bool_], by: NDArray[np.float64]) -> float:
    """The share held in the quarter that holds least."""
    return min(float(held[part].mean()) for part in np.array_split(np.argsort(by), 4) if len(part))
