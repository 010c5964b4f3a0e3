"""Presses alone, fitted by the forward model: how wide the intervals are, and how often they hold.

The lumps of `inverted`, each pressed once, a little beside its middle; in turn by the probe's own face, which
also measures how deep it goes, and by a flat array with a padding, which does not. What is done is kept in
DIRECTORY/pressed.jsonl; a study that was ended goes on where it stopped.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Any

import numpy as np

from palpate.errors import PalpateError
from palpate.inversion.classes import ANYWHERE
from palpate.inversion.press import invert_press
from palpate.link.face import Face
from palpate.sim.probe.noise import level_named
from palpate.sim.tissue import Case
from tests.host.inversion.world import press_of
from tests.studies.inverted import WORDS, lumps
from tests.studies.table import Asked, StudyTable, kept_rows, of_text

LUMPS = 60
FLAT = Face(math.inf, 2.0, 80.0)
BESIDE_MM = 3.0
"""At most so far from the lump's middle."""


def tables(asked: Asked) -> list[StudyTable]:
    """Press what is not yet pressed; then a table for each face."""
    cases = lumps(asked.lumps or LUMPS, asked.seed)
    noise, seed = asked.noise or "typical", 1000 * asked.seed
    rows = kept_rows(asked, "pressed.jsonl", len(cases), lambda k: pressed(cases[k], seed + k, noise))
    faces = {"flat and padded, no displacement": True, "the probe's own": False}
    return [judged(name, [row for row in rows if row["flat"] == flat]) for name, flat in faces.items()]


def pressed(case: Case, seed: int, noise: str) -> dict[str, Any]:
    """One press: each number's interval beside its truth."""
    flat = seed % 2 == 0
    felt = (
        replace(case, probe_radius_mm=math.inf, padding_mm_per_kPa=FLAT.yields_mm_per_kPa) if flat else case
    )
    row: dict[str, Any] = {"code": case.code, "flat": flat, "problem": ""}
    beside_mm = np.random.default_rng(seed).uniform(-BESIDE_MM, BESIDE_MM)
    begun = time.process_time()
    try:
        press = press_of(felt, seed, noise, beside_mm, not flat, FLAT if flat else None)
        begun = time.process_time()
        found = invert_press(press, level_named(noise), ANYWHERE.name)
    except PalpateError as error:  # no such tissue, no equilibrium, or a press that cannot be inverted
        return row | {"problem": str(error)}
    row |= {"cpu_s": time.process_time() - begun, "problem": found.problem or "", "fits": found.fits}
    for name in WORDS if not found.problem else ():
        value = found.values[name]
        row[name] = {"value": value.value, "low": value.low, "high": value.high, "truth": getattr(case, name)}
    return row


def judged(face: str, rows: list[dict[str, Any]]) -> StudyTable:
    """How often the intervals of those that fit hold, and their ends over the value, in the median."""
    fit = [row for row in rows if not row["problem"] and row["fits"]]
    out = []
    for name in WORDS:
        said = [row[name] for row in fit]
        inside = [_end(one["low"], -math.inf) <= one["truth"] <= _end(one["high"], math.inf) for one in said]
        off = [abs(math.log(one["value"] / one["truth"])) for one in said]
        ends = [np.median([_end(one[end], other) / one["value"] for one in said])
                for end, other in (("low", 0.0), ("high", math.inf))]  # fmt: skip
        out.append([name, f"{100 * np.mean(inside):.0f}", f"{100 * np.median(off):.0f}",
                    f"{ends[0]:.2f} to {ends[1]:.2f}"])  # fmt: skip
    whole = len([row for row in rows if not row["problem"]])
    title = (
        f"{face}: {len(rows)} presses, {len(rows) - whole} not inverted, {len(fit)} fit; "
        f"{np.median([row['cpu_s'] for row in rows if 'cpu_s' in row]):.0f} CPU s in the median"
    )
    return of_text(title, ["", "held, %", "error, %", "interval over value"], out)


def _end(value: float | None, otherwise: float) -> float:
    """An end that an interval lacks is no bound."""
    return otherwise if value is None else value
