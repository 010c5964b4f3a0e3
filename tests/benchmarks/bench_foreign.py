"""What adapting brings in the foreign world: python -m tests.benchmarks foreign

160 lumps, 4 strokes each, by one laboratory's sensor (tests/foreign_world.py). For each number of lumps some
are drawn, the model is adapted to them, or trained afresh on them, and judged on all the others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from palpate import models
from palpate.adaptation import recalibration
from palpate.adaptation.adapt import adapt_to, link_truth
from palpate.dataset.agreement import errors_of
from palpate.dataset.answers import OUTPUTS, JudgedAnswers, answers, found
from palpate.dataset.strokes import ObservedDataSet
from palpate.firmware_twin.replay_core import Replay
from palpate.learn.observed import NAMES
from palpate.learn.probe_model import fit_polynomial, from_link
from palpate.learn.ridge import all_terms
from palpate.model_export.integers import force_map as force_maps
from palpate.model_export.schema import ModelSpec
from palpate.spans import depth_mm
from tests.foreign_world import FRAMES, Laboratory, kept

STROKES, SIZES, DRAWS = 4, (5, 10, 20, 40), 60
DRAWS_AFRESH = 20
SHOWN = ("d_mm", "depth_mm", "t_mm", "h", "E_inv23")


def seen(spec: ModelSpec, lumps: int | None = None, strokes: int = STROKES, seed: int = 1) -> ObservedDataSet:
    """The foreign world's strokes as a model sees them."""
    laboratory, replay = Laboratory(seed), Replay(force_maps.blob(spec.force_map))
    rows, X, codes = [], [], []
    for k, field in enumerate(kept()[:lumps]):
        for number in range(strokes):
            model = laboratory.over(field, 100 * k + number)
            stream = model.stroke(FRAMES)
            codes.append(replay.stream(stream, model.calibration()))
            X.append(replay.features())
            case = field.low.case
            truth = {"d_mm": case.d_mm, "depth_mm": case.depth_mm, "h": case.h, "t_mm": case.t_mm}
            force = stream.truth.F_N_per_m
            rows.append(
                {"row": len(X) + 1, "lump": f"L{k}", "E_ratio": case.E_ratio, "F_N_per_m": force, **truth}
            )
    return ObservedDataSet(pd.DataFrame(rows), np.array(X), np.array(codes))


@dataclass(frozen=True)
class Score:
    """One output's bias (of the mean, in the errors' scale), median error, and coverage."""

    bias: float
    error: float
    covered: float


def scores(said: JudgedAnswers, rows: np.ndarray) -> dict[str, Score]:
    """Of the strokes `rows` in which a lump was found."""
    used = rows & said.lump
    out = {}
    for name in SHOWN:
        j = OUTPUTS.index(name)
        error = errors_of(name, said.value[used, j], said.truth[used, j])
        out[name] = Score(
            float(error.mean()), float(np.median(np.abs(error))), float(said.covered[used, j].mean())
        )
    return out


def afresh(spec: ModelSpec, part: ObservedDataSet, whole: ObservedDataSet) -> JudgedAnswers:
    """A linear model of the same features, trained on some lumps alone; intervals by leaving them out."""
    part = part.take(found(spec, part.X, part.status))
    Y, group = link_truth(spec, part), part.lump
    terms = all_terms(len(spec.features), 1)
    columns = [NAMES.index(name) for name in spec.features]
    ends = np.array([[o.lo, o.hi] for o in spec.outputs]).T
    lo, hi = (np.where([o.link == "ln" for o in spec.outputs], np.log(end), end) for end in ends)

    def fit(rows: np.ndarray):
        return fit_polynomial(spec.features, part.X[rows][:, columns], Y[rows], group[rows], terms, lo, hi)

    left = np.empty_like(Y)
    for lump in np.unique(group):
        left[group == lump] = fit(group != lump).predict(part.X[group == lump][:, columns])
    half = np.array([recalibration.factor(np.abs(Y - left)[:, j], group, 0.9) for j in range(Y.shape[1])])
    y = fit(np.ones(len(part), bool)).predict(whole.X[:, columns])
    base = answers(spec, whole)
    parts = {w: from_link(np.clip(y + s * half, lo, hi)) for w, s in (("value", 0), ("low", -1), ("high", 1))}
    spans = [
        depth_mm(*(tuple(float(parts[w][k, j]) for w in ("value", "low", "high")) for j in (1, 2, 3)))
        for k in range(len(y))
    ]
    full = {
        w: np.column_stack([parts[w], [s[i] for s in spans]]) for i, w in enumerate(("value", "low", "high"))
    }
    return JudgedAnswers(
        full["value"], full["low"], full["high"], base.truth, base.lump, base.in_domain, base.force_out,
        base.hardness, base.group, base.hard, base.level,
    )  # fmt: skip


def study(
    draws: int = DRAWS, sizes: tuple[int, ...] = SIZES, fresh: int = DRAWS_AFRESH, strokes: int = STROKES
) -> pd.DataFrame:
    """One row for each way, number of lumps, draw and output: bias, error, coverage on the lumps left out.

    In the first `fresh` draws a model is trained afresh, too.
    """
    spec = models.load(models.TOLD)
    whole = seen(spec, strokes=strokes)
    before = answers(spec, whole)
    visible = np.unique(whole.lump[before.lump])
    rows = []

    def add(way: str, n: int, draw: int, said: JudgedAnswers, left: np.ndarray) -> None:
        for name, s in scores(said, left).items():
            rows.append({"way": way, "lumps": n, "draw": draw, "output": name, **vars(s)})

    add("as it came", 0, 0, before, np.ones(len(whole), bool))
    for n in sizes:
        for draw in range(draws):
            drawn = np.random.default_rng((n, draw)).permutation(visible)[:n]
            part = np.isin(whole.lump, drawn)
            add("as it came", n, draw, before, ~part)
            add("adapted", n, draw, answers(adapt_to(spec, whole.take(part)).spec, whole), ~part)
            if draw < fresh:
                add("trained afresh", n, draw, afresh(spec, whole.take(part), whole), ~part)
    return pd.DataFrame(rows)


def table(found: pd.DataFrame) -> str:
    """The study as text: mean over the draws, in %; E^-2/3 in hundredths.

    Beside the coverage stands the half-width of its mean's 95 % interval over the draws.
    """
    lines = [
        f"{'':24}" + "".join(f"{name:>26}" for name in SHOWN),
        f"{'':24}" + f"{'bias  error  covered':>26}" * 5,
    ]
    for (way, n), part in found.groupby(["way", "lumps"], sort=False):
        if way == "as it came" and n:
            continue
        mean = part.groupby("output")[["bias", "error", "covered"]].mean()
        half = 1.96 * part.groupby("output")["covered"].sem().fillna(0.0)
        cells = "".join(
            f"{100 * mean.bias[o]:+11.1f}{100 * mean.error[o]:6.1f}"
            f"{100 * mean.covered[o]:5.0f}+-{100 * half[o]:.1f}"
            for o in SHOWN
        )
        lines.append(f"{way + (f', {n} lumps' if n else ''):24}{cells}")
    return "\n".join(lines)


def worse(found: pd.DataFrame) -> pd.DataFrame:
    """Share of the draws in which the adapted model's median error is the larger one, by output."""
    wide = found[found["lumps"] > 0].pivot_table(
        index=["lumps", "draw", "output"], columns="way", values="error"
    )
    return (wide["adapted"] > wide["as it came"]).groupby(["output", "lumps"]).mean().unstack()


def main() -> None:
    found = study()
    print(table(found))
    print("\nshare of draws in which adapting made the median error larger")
    print((100 * worse(found)).round().to_string())
