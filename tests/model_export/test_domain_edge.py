"""Where the model's domain ends the probe's flag changes, neither earlier nor later."""

from __future__ import annotations

import dataclasses
from array import array

import numpy as np
import pytest

from firmware_py import evaluator, feature_names, outputs
from firmware_py import features as firmware_features
from palpate.model_export.fixed_point import compiler
from tests.model_export import synthetic

ONE = 1 << 24


@pytest.fixture(scope="module")
def model():
    """One whose box and ranges are far away, so that the distance alone decides."""
    spec = synthetic.model("thesis")
    k = len(spec.features)
    domain = dataclasses.replace(
        spec.domain,
        lo=spec.clip_lo,
        hi=spec.clip_hi,
        ranges=((None, None),) * len(spec.domain.ranges),
        precision=tuple(map(tuple, (4 * np.eye(k)).tolist())),
        threshold=1.0,
    )
    return dataclasses.replace(spec, domain=domain, lump=())


@pytest.mark.parametrize("seed", range(6))
def test_the_flag_changes_where_the_distance_passes_the_threshold(model, seed):
    """At 1024 thousandths it still said "inside", and no test noticed."""
    tables = compiler.compile_model(model)
    way = np.random.default_rng(seed).normal(size=len(model.features))
    way /= np.linalg.norm(way)
    centre, scale = np.array(model.centre), np.array(model.scale)
    ids = [feature_names.NAMES.index(name) for name in model.features]
    told = []
    for far in np.linspace(0.97, 1.02, 200):  # its square is the distance
        x = array("i", bytes(4 * firmware_features.COUNT))
        for i, value in zip(ids, centre + scale * (np.array(model.domain.centre) + far / 2 * way)):
            x[i] = round(value * ONE)
        out = array("i", bytes(4 * evaluator.OUT_SIZE))
        tables.evaluate(x, out)
        told.append((far**2, bool(out[evaluator.FLAGS] & outputs.IN_DOMAIN), out[evaluator.DISTANCE]))
    assert {inside for at, inside, _ in told if at < 0.995} == {True}
    assert {inside for at, inside, _ in told if at > 1.005} == {False}
    assert all(inside == (permille <= 1000) for _, inside, permille in told)
