"""Lumps outside the ranges of the bundled models: what a probe says of them, and a host that fits the stroke.

As in `inverted`: computed on a mesh that the inversion does not use, every frame at its own place and force.
What is done is kept in DIRECTORY/outside.jsonl; a study that was ended goes on where it stopped.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate import models
from palpate.errors import PalpateError
from palpate.inversion.result import FITS
from palpate.inversion.start import said_of
from palpate.inversion.under import AUTO
from palpate.inversion.widening import WIDER
from palpate.sim.tissue import Case
from palpate.sim.tissue.any_tissue import rim_lumps
from palpate.sim.tissue.anywhere import anywhere_rim
from tests.host.inversion.world import felt_of, press_and_frames
from tests.studies.inverted import WORDS, fitted
from tests.studies.table import Asked, StudyTable, kept_rows, of_text

LUMPS = 20
"""Of each model."""
RIMS = {models.FIELD: rim_lumps, models.ANYWHERE: anywhere_rim}


def tables(asked: Asked) -> list[StudyTable]:
    """The probe's flags and the fit's answers, a row for each model."""
    n, noise = asked.lumps or LUMPS, asked.noise or "typical"
    rims = {name: rim(n, 9000 + asked.seed) for name, rim in RIMS.items()}
    lumps = [(name, case) for each in zip(*rims.values()) for name, case in zip(rims, each)]
    rows = kept_rows(
        asked, "outside.jsonl", len(lumps), lambda k: felt(*lumps[k], 1000 * asked.seed + k, noise)
    )
    return [judged(rows)]


def felt(model: str, case: Case, seed: int, noise: str) -> dict[str, Any]:
    """What the model, and then a fit of the same stroke, says of a lump."""
    try:
        stroke, start, stream, calibration = felt_of(case, seed, noise)
    except PalpateError as error:  # no such tissue, no equilibrium, or a stroke that cannot be inverted
        return {"code": case.code, "model": model, "found": False, "problem": str(error)}
    said, _ = said_of(*press_and_frames(stream), calibration, model)
    row = {"model": model, "found": bool(said), "flagged": bool(said) and not said["in_domain"][0]}
    return row | fitted(stroke, start, stream.truth, noise, AUTO)


def judged(rows: list[dict[str, Any]]) -> StudyTable:
    """Shares of the lumps that the probe finds; errors in the median."""
    out = []
    for model in RIMS:
        shown = [row for row in rows if row["model"] == model and row["found"]]
        if not shown:
            continue
        told = [row for row in shown if not row["problem"]]
        held = [_held(row) for row in shown]
        warned = [row["flagged"] or bool(row["problem"]) or row["chi2"] >= FITS for row in shown]
        right = [bool(one) and all(one[:3]) for one in held]
        out.append([
            model, str(len(shown)), _share(row["flagged"] for row in shown),
            _share(row["chi2"] < FITS for row in told),
            *(f"{100 * np.median([abs(row[name]['apart']) for row in told]):.1f}" for name in WORDS),
            " ".join(_share(of) for of in zip(*filter(None, held))),
            _share(right), _share(a or b for a, b in zip(warned, right)),
        ])  # fmt: skip
    heads = ["model", "found", "flagged", "fits", *WORDS, "held", "d, depth and t held",
             "flagged, not fitted or held"]  # fmt: skip
    return of_text("Lumps outside the ranges, found by the model; of those, fitted", heads, out)


def _held(row: dict[str, Any]) -> list[bool]:
    """Whether the interval holds the truth, by `WORDS`; nothing where there is no answer."""
    if row["problem"]:
        return []
    return [
        abs(row[name]["apart"]) <= WIDER[factor].half(row[name]["sd"], row["settled"])
        for name, factor in WORDS.items()
    ]


def _share(of: Any) -> str:
    return f"{100 * np.mean(list(of)):.0f}"
