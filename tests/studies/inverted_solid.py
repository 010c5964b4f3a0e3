"""Strokes over balls and ellipsoids fitted by emulator and solver: how far off, and how often intervals hold.

Lumps of `ball_cases` that no emulator has met, each stroked once: computed on narrower columns than the
inversion's, at places and forces of its own (`tests.host.inversion.solid_world`), then felt by a probe of
that noise. Computed strokes are kept in DIRECTORY/worlds, rows in DIRECTORY/inverted_solid.jsonl; a study
that was ended goes on where it stopped.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from palpate.answer.fitted import HARD, LEVEL
from palpate.errors import PalpateError
from palpate.inversion.result import FITS
from palpate.inversion.strokes import invert_stroke
from palpate.inversion.widening import WIDER_SOLID
from palpate.sim.probe.noise import level_named
from palpate.sim.tissue import Case
from palpate.sim.tissue.solid.design import ball_cases
from tests.host.inversion.solid_world import felt_over, kept_strokes
from tests.studies.inverted import halves_crossed, said_first, scale_of, truths_of
from tests.studies.table import Asked, StudyTable, kept_rows, of_text

LUMPS = 24
WORDS = {
    "d_mm": "ln d", "width_mm": "ln width", "depth_mm": "ln depth", "t_mm": "ln t", "E_inv23": "E^-2/3",
    "E_fat_kPa": "ln_E",
}  # fmt: skip
"""What is judged, and what widens it."""


def tables(asked: Asked) -> list[StudyTable]:
    """Invert what is not yet there; then accuracy, and factors from one half for the other."""
    cases = ball_cases(asked.lumps or LUMPS, asked.seed)[1::3]
    rows = kept_rows(asked, "inverted_solid.jsonl", len(cases), lambda k: inverted(cases[k], asked, k))
    return judged(rows)


def inverted(case: Case, asked: Asked, k: int) -> dict[str, Any]:
    """One stroke: how far regression and inversion are from the truth, and half-intervals before widening."""
    worlds = asked.directory / "worlds"
    worlds.mkdir(parents=True, exist_ok=True)
    noise = asked.noise or "typical"
    try:
        strokes = kept_strokes(worlds / f"{asked.seed}-{k}.npz", case)
        felt, start, stream = felt_over(*strokes, 1000 * asked.seed + k, noise)
    except PalpateError as error:
        return {"code": case.code, "problem": str(error)}
    if not felt.solid:
        return {"code": case.code, "problem": "its columns are even"}
    begun = time.process_time()
    found = invert_stroke(felt, start, level_named(noise))
    row: dict[str, Any] = {
        "code": case.code, "cpu_s": time.process_time() - begun, "problem": found.problem, "kind": found.kind,
    }  # fmt: skip
    if found.problem or not found.lump:
        return row | {"problem": found.problem or "told as no lump"}
    truth = truths_of(stream.truth) | {"width_mm": 2 * case.half_axes_mm[1]}
    first = said_first(start) | {"width_mm": start.d_mm}
    for name in WORDS:
        value, scale = found.values[name], scale_of(name)
        assert value.low is not None and value.high is not None
        low, middle, high, true, before = (
            scale(v) for v in (value.low, value.value, value.high, truth[name], first[name])
        )
        apart = middle - true
        half = middle - low if apart > 0 else high - middle
        used = _used(name, found.settled)
        row[name] = {"apart": apart, "half": half / used, "first": before - true, "truth": truth[name]}
    likely = (found.values["E_inv23"].value < HARD) == (case.E_inv23 < HARD)
    return row | {
        "chi2": found.chi2, "fits": found.fits, "settled": found.settled,
        "likely": bool(likely), "offset_mm": case.offset_mm,
    }  # fmt: skip


def _used(name: str, settled: bool) -> float:
    """What half an interval was widened by."""
    factors = WIDER_SOLID[WORDS[name]]
    return factors.settled if settled else factors.restless


def judged(rows: list[dict[str, Any]]) -> list[StudyTable]:
    """Errors and intervals of the rows, and what their intervals ask for; held out by halves."""
    whole = [row for row in rows if not row["problem"]]
    fits = np.array([row["chi2"] < FITS for row in whole])
    settled = np.array([row["settled"] for row in whole], bool)
    out = []
    for name in WORDS:
        apart, half, first = (
            np.array([row[name][key] for row in whole]) for key in ("apart", "half", "first")
        )
        used, asked = np.array([_used(name, of) for of in settled]), np.abs(apart) / half
        out.append([
            name, *(f"{100 * np.median(np.abs(e)):.1f}" for e in (first, apart, apart[fits])),
            f"{100 * np.median(used * half):.1f}", f"{100 * np.mean(asked <= used):.0f}",
            f"{_used(name, True):.2f}", f"{np.quantile(asked, LEVEL):.2f}",
            f"{100 * halves_crossed(asked):.0f}",
        ])  # fmt: skip
    likely = np.array([row["likely"] for row in whole])
    title = (
        f"{len(rows)} strokes over balls and ellipsoids: {len(rows) - len(whole)} not inverted, "
        f"{100 * fits.mean():.0f} % fit, {100 * settled.mean():.0f} % settled; "
        f"nearer to hard or soft, rightly, {100 * likely.mean():.0f} %; "
        f"{np.median([row['cpu_s'] for row in whole]):.0f} CPU s in the median"
    )
    heads = ["", "regression", "inversion", "those that fit", "half-width", "held", "factor used",
             "asked", "held, halves crossed"]  # fmt: skip
    return [of_text(title, heads, out)]
