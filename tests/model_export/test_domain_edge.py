"""Where the model's domain ends the probe's flag changes, neither earlier nor later."""

from __future__ import annotations

import dataclasses
from array import array

import numpy as np
import pytest

from firmware_py import evaluator, feature_names, outputs, status, verdict
from firmware_py import features as firmware_features
from palpate.model_export.integers import compiler
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


def judged(*, feature=50, rule=(0, 100), box=(0, 100), distance=0, beyond=0, force=50, E=(3, 5), border=4):
    """Flags and status of a stroke with one feature, as the probe's own function gives them."""
    out = [7] * verdict.OUT_SIZE
    out[verdict.FORCE], out[verdict.E_LOW], out[verdict.E_HIGH] = force, *E
    out[verdict.DISTANCE] = distance
    head = [0] * 9
    head[verdict.N_FEATURES] = head[verdict.N_LIMITS] = 1
    head[verdict.HARD_BELOW], head[verdict.FORCE_LO], head[verdict.FORCE_HI] = border, 20, 80
    row = [0] * verdict.FEATURE_ROW
    row[verdict.BOX_LO], row[verdict.BOX_HI] = box
    work = [0] * (verdict.OUTPUTS - 1) + [beyond]
    code = verdict.verdict([feature], [0], row, [0, *rule], head, work, out)
    return out, code


LUMP_IN = outputs.LUMP | outputs.IN_DOMAIN


@pytest.mark.parametrize(
    ("changes", "flags"),
    [
        ({}, LUMP_IN),
        ({"feature": 0}, LUMP_IN),
        ({"feature": 100}, LUMP_IN),
        ({"feature": -1, "rule": (-9, 100)}, outputs.LUMP),
        ({"feature": 101, "rule": (0, 109)}, outputs.LUMP),
        ({"distance": verdict.EDGE}, LUMP_IN),
        ({"distance": verdict.EDGE + 1}, outputs.LUMP),
        ({"beyond": 1}, outputs.LUMP),
        ({"E": (1, 3)}, LUMP_IN | outputs.HARD),
        ({"E": (1, 4)}, LUMP_IN),
        ({"E": (4, 9)}, LUMP_IN | outputs.SOFT),
        ({"force": 20}, LUMP_IN),
        ({"force": 80}, LUMP_IN),
        ({"force": 19}, LUMP_IN | outputs.FORCE_OUT),
        ({"force": 81}, LUMP_IN | outputs.FORCE_OUT),
    ],
)
def test_what_lies_on_an_edge_is_inside_and_one_more_is_not(changes, flags):
    out, code = judged(**changes)
    assert (out[verdict.FLAGS], code) == (flags, status.OK)


@pytest.mark.parametrize("feature", [9, 91])
def test_where_the_rule_finds_no_lump_no_number_is_told(feature):
    out, code = judged(feature=feature, rule=(10, 90), E=(1, 3), force=19)
    assert code == status.NO_LUMP and out[: verdict.FLAGS] == [0] * verdict.FLAGS
    assert out[verdict.FLAGS] == outputs.IN_DOMAIN
