"""Studies for a probe's designer: error against each property that could be better or worse.

Every study retrains the field model for each setting (a device is calibrated as it is) and scores it on the
same held-out lumps, at the bench's noise but for what is varied.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_py import geometry
from palpate.learn.model import fit_model
from palpate.learn.scopes import FIELD, TOLD, Recipe
from palpate.sim.probe.sensors import Noise
from tests.studies.retrained import Bench, Row, Study, row_of


def _row(bench: Bench, setting: str, noise: Noise, recipe: Recipe = FIELD, **sensor: Any) -> Row:
    train, rim, test = bench.parts(noise, **sensor)
    return row_of(setting, fit_model(TOLD.of(recipe), train, rim), test)[0]


def _white(bench: Bench) -> Iterator[Row]:
    for white in (0.0, 0.001, 0.0025, 0.005, 0.01):
        yield _row(bench, f"{white:.2%}", bench.noise.with_(white=white))


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
    bare = replace(FIELD, name="field, no force map", most=None)
    for force in (0.0, 0.05, 0.1, 0.2, 0.3):
        yield _row(bench, f"+-{100 * force:g} %", bench.noise.with_(force=force))
    for force in (0.05, 0.1, 0.2):
        yield _row(
            bench,
            f"+-{100 * force:g} %, frames not moved",
            bench.noise.with_(force=force),
            bare,
            force_map=None,
        )


STUDIES: dict[str, Study] = {
    s.name: s
    for s in (
        Study("noise", "White noise of the sensors", "white noise, of full scale", _white),
        Study("bits", "Resolution of the ADC", "ADC", _bits),
        Study("pitch", "Cell pitch along the stroke", "pitch", _pitch),
        Study("dead", "Dead cells", "dead cells", _dead),
        Study("force", "The hand's force", "force wanders by", _force),
    )
}
