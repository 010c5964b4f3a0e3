"""The eight phantoms of Egorov and Sarvazyan, simulated: one soft material, 35 mm thick, with a ball in it.

Their Table II (IEEE Trans. Biomed. Eng. 55, 2008) has balls of 5 to 18 mm, of 10 to 156 kPa in 5 kPa, 10 mm
deep: here their tops lie there. Each is stroked three times by one probe: the strokes are fitted together,
and the first alone. Computed strokes are kept in DIRECTORY/worlds, rows in DIRECTORY/phantoms.jsonl.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from palpate.answer.fitted import Inverted
from palpate.inversion.kept import Felt
from palpate.inversion.strokes import invert_together
from palpate.sim.probe.noise import level_named
from palpate.sim.tissue import Case
from tests.host.inversion.solid_world import felt_over, kept_strokes
from tests.studies.table import Asked, StudyTable, kept_rows, of_text

BALLS_MM_KPA = ((5, 20), (5, 80), (10, 10), (10, 40), (14, 40), (14, 156), (18, 20), (18, 80))
BASE_KPA, THICK_MM, DEEP_MM = 5.0, 35.0, 10.0
FORCE = 0.4
"""Presses about 4 mm deep."""
STROKES = 3
WORDS = {"d_mm": "d", "depth_mm": "depth", "E_kPa": "E", "E_fat_kPa": "base"}


def phantom(d_mm: float, E_kPa: float) -> Case:
    """One of them; the border between two layers of one material passes through the ball."""
    return Case(
        float(d_mm), DEEP_MM / d_mm, E_kPa / BASE_KPA, FORCE, fat_kPa=BASE_KPA, shape="ball", gland_ratio=1.0,
        gland_mm=THICK_MM - DEEP_MM - d_mm / 2,
    )  # fmt: skip


def tables(asked: Asked) -> list[StudyTable]:
    """Fit what is not yet there; then errors of each phantom, and their means."""
    rows = kept_rows(asked, "phantoms.jsonl", len(BALLS_MM_KPA), lambda k: row_of(k, asked))
    return judged(rows)


def row_of(k: int, asked: Asked) -> dict[str, Any]:
    """What single strokes and all together say of a phantom."""
    case, noise = phantom(*BALLS_MM_KPA[k]), asked.noise or "typical"
    worlds = asked.directory / "worlds"
    worlds.mkdir(parents=True, exist_ok=True)
    strokes = kept_strokes(worlds / f"{k}.npz", case)
    seeds = [1000 * asked.seed + STROKES * k + i for i in range(STROKES)]
    felt: list[Felt] = [felt_over(*strokes, seed, noise, probe=asked.seed)[:2] for seed in seeds]
    begun = time.process_time()
    together = invert_together(felt, level_named(noise))
    took = time.process_time() - begun
    alone = invert_together(felt[:1], level_named(noise))
    return {
        "code": case.code, "solid": [stroke.solid for stroke, _ in felt], "cpu_s": took,
        "regression": [start.d_mm for _, start in felt], "together": _said(together, case),
        "alone": _said(alone, case),
    }  # fmt: skip


def _said(found: Inverted, case: Case) -> dict[str, Any]:
    """Errors as parts of the truth, and whether intervals hold it."""
    out: dict[str, Any] = {"kind": found.kind, "fits": found.fits, "problem": found.problem}
    for name, true in zip(WORDS, (case.d_mm, case.depth_mm, case.E_ratio * BASE_KPA, BASE_KPA)):
        if (value := found.values.get(name)) is not None:
            held = (value.low or 0.0) <= true <= (np.inf if value.high is None else value.high)
            out[name] = {"apart": value.value / true - 1, "held": bool(held)}
    return out


def judged(rows: list[dict[str, Any]]) -> list[StudyTable]:
    """A row for each phantom, strokes together; then means of what was found."""
    heads = ["ball", "class", "fits", *(f"{word}, %" for word in WORDS.values()), "held", "CPU s"]
    lines = []
    for row, (d, E) in zip(rows, BALLS_MM_KPA):
        one = row["together"]
        cells = [f"{100 * one[name]['apart']:+.0f}" if name in one else "" for name in WORDS]
        held = "".join("+" if one[name]["held"] else "-" for name in WORDS if name in one)
        lines.append([f"{d} mm, {E} kPa", one["kind"], str(one["fits"]), *cells, held, f"{row['cpu_s']:.0f}"])
    for words, said in (
        ("mean, together", [row["together"] for row in rows]),
        ("mean, one stroke", [row["alone"] for row in rows]),
    ):
        fits = [one for one in said if one["fits"] and "d_mm" in one]
        cells = [f"{100 * np.mean([abs(one[name]['apart']) for one in fits]):.0f}" for name in WORDS]
        held = np.mean([one[name]["held"] for one in fits for name in WORDS])
        lines.append([words, "", f"{len(fits)} of {len(said)}", *cells, f"{100 * held:.0f} %", ""])
    return [of_text("Egorov's and Sarvazyan's phantoms, simulated", heads, lines)]
