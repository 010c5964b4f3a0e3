"""Studies for a probe's designer: error against each property that could be better or worse.

Every study retrains the field model for each setting (a device is calibrated as it is) and scores it on the
same held-out lumps, at the bench's noise but for what is varied.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_py import geometry
from palpate.learn.bench import Bench
from palpate.learn.model import FittedModel, fit_model
from palpate.learn.observed import NAMES, Observed, joined
from palpate.learn.ridge import FOLDS
from palpate.learn.scopes import FIELD, PRESSURE_ONLY, TOLD, Recipe
from palpate.learn.table import TARGETS
from palpate.sim.probe.sensors import Noise
from tests.studies.retrained import DRAWS, Row, Study, row_of

PAIR_LN = np.log(1.4)


def _row(bench: Bench, setting: str, noise: Noise, recipe: Recipe = FIELD, **sensor: Any) -> Row:
    train, calibration, test, rim = bench.parts(noise, recipe, DRAWS, **sensor)
    return row_of(setting, fit_model(TOLD.of(recipe), train, calibration, rim), test)


def _varied(**values: Any) -> Callable[[Bench], Iterator[Row]]:
    """A study of one field of `Noise`: name=(label format, values)."""
    ((name, (label, levels)),) = values.items()

    def run(bench: Bench) -> Iterator[Row]:
        for level in levels:
            yield _row(bench, label.format(level), bench.noise.with_(**{name: level}))

    return run


def _bits(bench: Bench) -> Iterator[Row]:
    for bits in (6, 8, 10, 12):
        yield _row(bench, f"{bits} bit", bench.noise, alter=partial(_coarser, step=1 << (12 - bits)))


def _coarser(counts: NDArray[np.uint16], step: int) -> NDArray[np.uint16]:
    return np.minimum(counts // step * step + step // 2, geometry.FULL_COUNT).astype(np.uint16)


def _paired(counts: NDArray[np.uint16]) -> NDArray[np.uint16]:
    cells = counts.reshape(len(counts), geometry.HALF_ROWS, 2, geometry.COLUMNS).mean(axis=2)
    return np.repeat(np.rint(cells).astype(np.uint16), 2, axis=1).reshape(len(counts), -1)


def _pitch(bench: Bench) -> Iterator[Row]:
    yield _row(bench, "1.5 mm (16 rows)", bench.noise)
    yield _row(bench, "3 mm (8 rows)", bench.noise, alter=_paired)


def _dead(bench: Bench) -> Iterator[Row]:
    for share in (0.0, 0.01, 0.05, 0.1):
        yield _row(bench, f"{100 * share:g} %, known", bench.noise.with_(dead=share))
    yield _row(bench, "1 %, unknown", bench.noise.with_(dead=0.01, dead_unknown=1.0))


def _force(bench: Bench) -> Iterator[Row]:
    bare = replace(FIELD, name="field, no force map", force_map=False, most=None)
    for force in (0.0, 0.05, 0.1, 0.2, 0.3):
        yield _row(bench, f"+-{100 * force:g} %", bench.noise.with_(force=force))
    for force in (0.05, 0.1, 0.2):
        yield _row(bench, f"+-{100 * force:g} %, frames not moved", bench.noise.with_(force=force), bare)


def _displacement(bench: Bench) -> Iterator[Row]:
    yield _row(bench, "pressure only", bench.noise, PRESSURE_ONLY)
    for zero in (0.0, 0.05, 0.1, 0.3):
        noise = bench.noise.with_(displacement_zero_mm=zero)
        yield _row(bench, f"with displacement, zero good to {1e3 * zero:g} um", noise)


def _learning(bench: Bench) -> Iterator[Row]:
    train, calibration, test, _ = bench.parts(bench.noise, draws=DRAWS)
    lumps = np.random.default_rng(bench.seed).permutation(bench.split.train)
    linear = Recipe("degree 1", FIELD.features, 1)
    square = Recipe("degree 2", FIELD.features, 2)
    for recipe in (linear, square, FIELD):
        for n in (50, 100, 200, 400, 800, 1600):
            if n > len(lumps) and n // 2 >= len(lumps):
                continue
            some = train.take(np.isin(train.group, lumps[:n]))
            if len(np.unique(some.group)) < 4 * FOLDS:
                continue
            name = "field" if recipe is FIELD else recipe.name
            yield row_of(
                f"{name}, {min(n, len(lumps))} lumps", fit_model(TOLD.of(recipe), some, calibration), test
            )


_CHANGES = ("ln_force", "asinh_amp", "ln_d_far", "dip_6_10", "asinh_rise")


def _forces(bench: Bench) -> Iterator[Row]:
    """One stroke; two at one force, averaged; two at forces 18 % apart, averaged, and as one larger model."""
    s = bench.split

    def at(shift: float, first_draw: int) -> tuple[Observed, ...]:
        parts = []
        for which, draws in zip((s.train, s.calibration, s.test), DRAWS):
            chosen = [bench.lumps[k] for k in which]
            means = [f.low.F_N_per_m * float(np.exp(PAIR_LN * shift)) for f in chosen]
            parts.append(
                bench.observe(bench.lumps, which, bench.noise, draws, first_draw, mean_forces_N_per_m=means)
            )
        return tuple(parts)

    middle, again, low, high = at(0.5, 0), at(0.5, 500), at(0.25, 1000), at(0.75, 1500)
    model = fit_model(TOLD.of(FIELD), middle[0], middle[1])
    yield row_of("one stroke", model, middle[2])
    yield _mean_row("two strokes at one force", model, middle[2], again[2])
    both = fit_model(TOLD.of(FIELD), joined([low[0], high[0]]), joined([low[1], high[1]]))
    yield _mean_row("two strokes, forces 18 % apart", both, low[2], high[2])
    yield _joint_row("the same as one model of both", low, high)


def _mean_row(setting: str, model: FittedModel, a: Observed, b: Observed) -> Row:
    first, second = model.answer(a), model.answer(b)
    both = first.found & second.found
    y = (first.y + second.y) / 2
    mean = model.answer_from((a.features(FIELD.features) + b.features(FIELD.features)) / 2, y, both)
    row = row_of(setting, model, replace(a, truth=(a.truth + b.truth) / 2), mean)
    # The model's intervals are those of one stroke; for the mean of two they would be too wide.
    return row | {f"{t}_half": float("nan") for t in TARGETS} | {"decided": float("nan")}


def _joint_row(setting: str, low: tuple[Observed, ...], high: tuple[Observed, ...]) -> Row:
    """Features averaged, with the changes between the two forces in place of features that go unused."""
    spare = [n for n in NAMES if n not in FIELD.features][: len(_CHANGES)]

    def joined(a: Observed, b: Observed) -> Observed:
        X = (a.X + b.X) / 2
        for name, change in zip(spare, _CHANGES):
            k = NAMES.index(change)
            X[:, NAMES.index(name)] = b.X[:, k] - a.X[:, k]
        truth = (a.truth + b.truth) / 2
        return replace(a, X=X, truth=truth, whole=a.whole & b.whole, found=a.found & b.found)

    recipe = Recipe("two forces", (*FIELD.features, *spare[: 24 - len(FIELD.features)]), 2)
    train, calibration, test = (joined(a, b) for a, b in zip(low, high))
    return row_of(setting, fit_model(TOLD.of(recipe), train, calibration), test)


STUDIES: dict[str, Study] = {
    s.name: s
    for s in (
        Study("noise", "White noise of the sensors", "white noise, of full scale",
              _varied(white=("{:.2%}", (0.0, 0.001, 0.0025, 0.005, 0.01)))),
        Study("bits", "Resolution of the ADC", "ADC", _bits),
        Study("pitch", "Cell pitch along the stroke", "pitch", _pitch),
        Study("gain", "Gain spread of the cells", "gain spread",
              _varied(gain=("{:.0%}", (0.0, 0.01, 0.02, 0.03, 0.05, 0.1)))),
        Study("dead", "Dead cells", "dead cells", _dead),
        Study("position", "Position error", "position noise",
              _varied(position_mm=("{:g} mm", (0.0, 0.25, 0.5, 1.0)))),
        Study("force", "The hand's force", "force wanders by", _force),
        Study("displacement", "Pressure only against pressure and displacement", "sensors", _displacement),
        Study("forces", "One force against several", "strokes", _forces),
        Study("learning", "Learning curve", "model, training lumps", _learning),
    )
}  # fmt: skip
