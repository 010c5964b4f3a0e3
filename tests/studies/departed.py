"""Strokes over what no class of tissue and lump holds: how often the inversion says so, and of others too.

Lumps anywhere as in `inverted`, each stroked five times: as it is; in tissue whose thickness swings by 5 %
along the stroke; by a face that rubs with a coefficient of .2; and with a second lump of its kind 8 mm beside
it, or 14 mm where that leaves them apart. Rows are kept in DIRECTORY/departed.jsonl.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from palpate.errors import PalpateError
from palpate.inversion.classes import ANYWHERE
from palpate.inversion.departures import FRICTION, TWO_LUMPS, UNDULATING
from palpate.inversion.result import FITS
from palpate.inversion.strokes import AUTO, invert_stroke
from palpate.sim.probe.noise import level_named
from palpate.sim.tissue import Case
from tests.host.inversion.world import ExactField, TwoAlike, felt_of
from tests.studies.inverted import lumps
from tests.studies.table import Asked, StudyTable, kept_rows, of_text

LUMPS = 20
AS_IT_IS = "as it is"
FARTHER = "two lumps, 14 mm"
WORLDS = (AS_IT_IS, UNDULATING, FRICTION, TWO_LUMPS, FARTHER)
_APART_MM = {TWO_LUMPS: 8.0, FARTHER: 14.0}
_UNDULATION, _FRICTION = 0.05, 0.2
_FALSE_ALARMS, _RIGHT = 0.05, 0.2


def tables(asked: Asked) -> list[StudyTable]:
    """Invert what is not yet there; then how often each departure was told."""
    cases = lumps(asked.lumps or LUMPS, asked.seed)

    def strokes(k: int) -> dict[str, Any]:
        each = {world: departed(cases[k], world, 1000 * asked.seed + k, asked.noise) for world in WORLDS}
        return {"code": cases[k].code, **each}

    return judged(kept_rows(asked, "departed.jsonl", len(cases), strokes))


def departed(case: Case, world: str, seed: int, noise: str | None) -> dict[str, Any]:
    """What the inversion says of one stroke in one of the `WORLDS`."""
    level = level_named(noise or "typical")
    felt_by = level.with_(undulation=_UNDULATION) if world == UNDULATING else level
    if world == FRICTION:
        case = replace(case, friction=_FRICTION)
    apart_mm = _APART_MM.get(world)
    if world == FARTHER and case.d_mm > _APART_MM[FARTHER]:
        return {"problem": "they would overlap"}
    try:
        field = ExactField(case) if apart_mm is None else TwoAlike(case, apart_mm)
        felt, start, _, _ = felt_of(case, seed, felt_by, field=field)
    except PalpateError as error:
        return {"problem": str(error)}
    found = invert_stroke(felt, start, level, ANYWHERE.name if apart_mm is None else AUTO)
    sizes = [found.values[key].value / case.d_mm for key in ("d_mm", "d2_mm") if key in found.values]
    return {
        "problem": found.problem, "odds": found.classes, "chi2": found.chi2,
        "fits": found.fits and found.kind != TWO_LUMPS, "sizes": sizes,
    }  # fmt: skip


def judged(rows: list[dict[str, Any]]) -> list[StudyTable]:
    """How often a stroke does not fit, and what it is taken for; the same at 5 % false alarms."""

    def alarm(row: dict[str, Any]) -> float:
        """What is left of the class' own odds, and of its fit."""
        return max(1 - row["odds"].get(ANYWHERE.name, 0.0), row["chi2"] / FITS - 1)

    plain = [alarm(row[AS_IT_IS]) for row in rows if not row[AS_IT_IS]["problem"]]
    limit = float(np.quantile(plain, 1 - _FALSE_ALARMS, method="higher"))
    out = []
    for world in WORLDS:
        told = [row[world] for row in rows if not row[world]["problem"]]
        named = [max(row["odds"], key=lambda name: row["odds"][name]) for row in told]
        shares = (
            [not row["fits"] for row in told],
            [row["chi2"] >= FITS for row in told],
            [name == (TWO_LUMPS if world == FARTHER else world) for name in named],
            [alarm(row) > limit for row in told],
        )
        said = [row["sizes"] for row in told if len(row.get("sizes", ())) > 1]
        right = [all(abs(np.log(size)) < np.log(1 + _RIGHT) for size in sizes) for sizes in said]
        out.append([
            world, str(len(told)), *(f"{100 * np.mean(share):.0f} %" for share in shares),
            f"{sum(right)} of {len(said)}" if said else "",
        ])  # fmt: skip
    heads = [
        "", "strokes", "does not fit as one lump", "by its misfit", "taken for it", "at 5 % false alarms",
        "both sizes within 20 %",
    ]  # fmt: skip
    return [of_text("What no class of tissue and lump holds", heads, out)]
