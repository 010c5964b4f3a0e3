"""Strokes over tissue a little unlike every model: whether intervals hold the truth, or a fit is refused.

Lumps anywhere as in `inverted`, each stroked three times: over a gland whose modulus rises by 10 % from
top to bottom; over an ellipse 1.15 times as wide as it is high, whose width is d; and under `real` noise,
which has waves, hysteresis and cells that stick, fitted as such. Rows are kept in DIRECTORY/unlike.jsonl.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from skfem import MeshQuad2

from palpate.errors import PalpateError
from palpate.inversion.classes import ANYWHERE
from palpate.inversion.strokes import invert_stroke
from palpate.sim.probe.noise import level_named
from palpate.sim.tissue import Case, run
from palpate.sim.tissue.element import integrate
from palpate.sim.tissue.layers import GLAND
from palpate.sim.tissue.material import Elasticity, elasticity
from palpate.sim.tissue.mesh import TissueMesh
from tests.host.inversion.world import ExactField, felt_of
from tests.studies.inverted import WORDS, lumps, scale_of, truths_of
from tests.studies.table import Asked, StudyTable, kept_rows, of_text

LUMPS = 20
GRADED, ELLIPSE, REAL = "gland graded by 10 %", "ellipse, 1.15 : 1", "real noise"
WORLDS = (GRADED, ELLIPSE, REAL)
_GRADED, _WIDER = 0.10, 1.15
_YIELDS = 0.8
"""Of the way from an ellipse to the skin its surroundings give way."""


def tables(asked: Asked) -> list[StudyTable]:
    """Invert what is not yet there; then how often each number was held, and how often a fit was refused."""
    cases = lumps(asked.lumps or LUMPS, asked.seed)

    def strokes(k: int) -> dict[str, Any]:
        return {"code": cases[k].code} | {
            world: unlike(cases[k], world, 1000 * asked.seed + k) for world in WORLDS
        }

    return judged(kept_rows(asked, "unlike.jsonl", len(cases), strokes))


def unlike(case: Case, world: str, seed: int) -> dict[str, Any]:
    """What the inversion says of one stroke in one of the `WORLDS`, and whether it holds the truth."""
    level = level_named("real" if world == REAL else "typical")
    try:
        field = {GRADED: GradedField, ELLIPSE: EllipseField}.get(world, ExactField)(case)
        felt, start, stream, _ = felt_of(case, seed, level, field=field)
    except PalpateError as error:
        return {"problem": str(error)}
    truths = truths_of(stream.truth)
    if world == ELLIPSE:
        truths |= {
            "d_mm": case.d_mm * _WIDER**0.5,
            "depth_mm": case.depth_mm + case.d_mm / 2 * (1 - _WIDER**-0.5),
        }
    found = invert_stroke(felt, start, level, ANYWHERE.name)
    if found.problem or not found.lump:
        return {"problem": found.problem or "told as no lump"}
    held, apart = {}, {}
    for name in WORDS:
        value = found.values[name]
        assert value.high is not None
        held[name] = value.low <= truths[name] <= value.high
        scale = scale_of(name)
        apart[name] = scale(value.value) - scale(truths[name])
    return {"problem": "", "fits": found.fits, "held": held, "apart": apart}


class GradedField(ExactField):
    """Over a gland whose modulus rises from its top to its bottom."""

    def at(self, position_mm, force_N_per_m):
        """As `ExactField.at`."""
        with patch.object(run, "elasticity", graded):
            return super().at(position_mm, force_N_per_m)


def graded(case: Case, mesh: TissueMesh) -> Elasticity:
    """As `elasticity`, but for the gland."""
    plain = elasticity(case, mesh)
    border, end = case.borders_mm[:2]
    height = mesh.nodes_mm[mesh.elements[:, 4], 1]
    share = np.clip((border - height) / (border - end), 0.0, 1.0) - 0.5
    factor = np.where(mesh.material == GLAND, 1 + _GRADED * share, 1.0)
    return replace(plain, mu=plain.mu * factor, bulk=plain.bulk * factor)


class EllipseField(ExactField):
    """Over an ellipse as large as the lump, but wider than it is high."""

    def __init__(self, case: Case) -> None:
        super().__init__(case)
        mesh = self._geometry.mesh
        moved = flattened(mesh.nodes_mm, case.d_mm / 2, _YIELDS * case.depth_mm)
        mesh = replace(mesh, nodes_mm=moved, quads=MeshQuad2(moved.T.copy(), mesh.quads.t))
        self._geometry = replace(self._geometry, mesh=mesh, integrals=integrate(mesh))


def flattened(nodes_mm: NDArray[np.float64], radius_mm: float, yields_mm: float) -> NDArray[np.float64]:
    """Nodes (N, 2) moved so that the circle of a radius is an ellipse; so far from it they stay."""
    away = np.hypot(*nodes_mm.T) - radius_mm
    share = np.clip(1 - away / yields_mm, 0.0, 1.0)
    wider = _WIDER ** (0.5 * share)
    return nodes_mm * np.column_stack([wider, 1 / wider])


def judged(rows: list[dict[str, Any]]) -> list[StudyTable]:
    """How often a stroke does not fit; of those that fit the share held, and errors in the median."""
    out = []
    for world in WORLDS:
        told = [row[world] for row in rows if not row[world]["problem"]]
        fit = [row for row in told if row["fits"]]
        right = [all(row["held"].values()) for row in fit]
        out.append([
            world, str(len(told)), f"{100 * (1 - len(fit) / len(told)):.0f} %",
            *(_held_and_apart(fit, name) for name in WORDS),
            f"{sum(right)} of {len(fit)}",
        ])  # fmt: skip
    heads = ["", "strokes", "does not fit", *WORDS, "all five held"]
    return [of_text("Tissue and sensors unlike the model's: held, and median error in %", heads, out)]


def _held_and_apart(rows: list[dict[str, Any]], name: str) -> str:
    if not rows:
        return ""
    held = np.mean([row["held"][name] for row in rows])
    apart = np.median([abs(row["apart"][name]) for row in rows])
    return f"{100 * held:.0f} %, {100 * apart:.1f}"
