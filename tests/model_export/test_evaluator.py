"""The integer evaluator against float64, and the proof that its integers stay small."""

from __future__ import annotations

import dataclasses
from array import array

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_py import evaluator, scales, status
from firmware_py import features as firmware_features
from palpate.model_export.errors import ProofError
from palpate.model_export.integers import accuracy, bounds, compiler, reference, sampling
from tests.firmware_py import checked_int
from tests.model_export import synthetic


@pytest.mark.parametrize("kind", ["thesis", "field"])
def test_10000_random_vectors_of_the_domain_agree_with_float64(kind):
    spec = synthetic.model(kind)
    errors = accuracy.measure(spec, compiler.compile_model(spec), sampling.in_domain(spec, 10000))
    assert errors.n == 10000
    assert max(errors.median.values()) < 5e-6
    assert max(errors.worst.values()) < 5e-5
    assert max(errors.worst_interval.values()) < 5e-5
    assert errors.flags_agree > 0.999  # the rest sit on a limit


@pytest.mark.parametrize("seed", [1, 2])
def test_a_cubic_model_of_364_terms_is_proved_and_within_the_same_limits(seed):
    spec = synthetic.model("field", degree=3, seed=seed)
    tables = compiler.compile_model(spec)
    bounds.prove(tables)
    errors = accuracy.measure(spec, tables, sampling.in_domain(spec, 3000))
    assert max(errors.median.values()) < 5e-6
    assert max(errors.worst.values()) < 5e-5
    assert max(errors.worst_interval.values()) < 5e-5


def test_the_evaluators_own_exponential_is_within_a_millionth():
    v = np.arange(-(2**28), 29 * 11629080, 9973)
    got = np.array([scales.exp(x, 24) for x in v.tolist()])
    exact = np.exp(v / 2**24)
    held = exact > 2**30 - 1
    assert np.all(np.abs(got - exact)[~held] <= 1e-6 * exact[~held] + 1)
    assert np.all(got[held] <= 2**30 - 1)
    got = np.array([scales.exp(x, 0) for x in range(-(2**28), 34887240, 9973)])
    exact = np.exp(np.arange(-(2**28), 34887240, 9973) / 2**24) * 2**24
    assert np.all(np.abs(got - exact) <= 1e-6 * exact + 1)


def test_every_intermediate_of_random_vectors_stays_within_2_30(field, field_tables):
    watched, watch = checked_int.load(("scales", "polynomial", "verdict", "evaluator"))
    t, plain, got = field_tables, *(array("i", [0] * evaluator.OUT_SIZE) for _ in range(2))
    rng = np.random.default_rng(3)
    wild = rng.integers(-(2**29) + 1, 2**29, (20, firmware_features.COUNT)).tolist()
    for row in wild + accuracy_inputs(field, 20):
        for compute, out in ((evaluator.compute, plain), (watched.evaluator.compute, got)):
            compute(
                array("i", row), t.ids, t.feats, t.steps, t.c, t.d, t.own, t.rows, t.outs, t.head, t.u,
                t.part, t.high, t.work, out,
            )  # fmt: skip
        assert got == plain
    assert 2**28 < watch.most < 2**30


def accuracy_inputs(spec, n):
    """Whole feature rows (all of the firmware's) with vectors of the domain in the model's places."""
    rows = []
    for vector in sampling.in_domain(spec, n):
        row = [0] * firmware_features.COUNT
        for ident, value in zip(compiler.feature_ids(spec.features), vector):
            row[ident] = round(value * 2**24)
        rows.append(row)
    return rows


def test_the_proof_covers_what_is_seen_and_refuses_a_model_that_could_overflow(field, field_tables):
    proof = bounds.prove(field_tables)
    assert 0 < proof.largest < 2**30
    # a table tampered with so that one sum can leave the range
    tables = compiler.compile_model(field)
    for i in range(40):
        tables.c[i] = 32767
    with pytest.raises(ProofError, match="2\\^30"):
        bounds.prove(tables)


def test_coefficients_beyond_the_integers_are_refused(field):
    huge = dataclasses.replace(
        field.outputs[1], coefficients=tuple(v * 1e9 for v in field.outputs[1].coefficients)
    )
    outputs = (field.outputs[0], huge, *field.outputs[2:])
    with pytest.raises(ProofError, match="t_mm"):
        bounds.prove(compiler.compile_model(dataclasses.replace(field, outputs=outputs)))


@settings(max_examples=30, deadline=None)
@given(st.lists(st.integers(-(2**29) + 1, 2**29 - 1), min_size=28, max_size=28))
def test_whatever_the_features_the_answer_is_ordered_and_in_range(thesis, thesis_tables, row):
    x = array("i", (row + [0] * firmware_features.COUNT)[: firmware_features.COUNT])
    out = array("i", [0] * evaluator.OUT_SIZE)
    code = thesis_tables.evaluate(x, out)
    assert code in (status.OK, status.NO_LUMP)
    for j, output in enumerate(thesis.outputs):
        value, low, high = (out[3 * j + k] / 1e6 for k in range(3))
        if code == status.NO_LUMP:
            assert value == low == high == 0
        else:
            assert low <= value <= high
            assert output.lo * (1 - 1e-5) <= low and high <= output.hi * (1 + 1e-5) + 1e-6


def evaluate(tables, row):
    out = array("i", [0] * evaluator.OUT_SIZE)
    return tables.evaluate(array("i", row), out), out


def test_no_lump_where_the_rule_says_so(field, field_tables):
    (row,) = accuracy_inputs(field, 1)
    code, out = evaluate(field_tables, row)
    assert code == status.OK and out[evaluator.FLAGS] & evaluator.LUMP
    limit = field.lump[0]
    row[compiler.feature_ids([limit.feature])[0]] = round((limit.lo - 0.01) * 2**24)
    code, out = evaluate(field_tables, row)
    assert code == status.NO_LUMP == evaluator.NO_LUMP
    assert not out[evaluator.FLAGS] & evaluator.LUMP and not any(out[: evaluator.FLAGS])


def test_a_feature_outside_the_box_or_far_from_the_rest_is_out_of_domain(field, field_tables):
    (row,) = accuracy_inputs(field, 1)
    assert evaluate(field_tables, row)[1][evaluator.FLAGS] & evaluator.IN_DOMAIN
    for i, ident in enumerate(compiler.feature_ids(field.features)):
        moved = list(row)
        moved[ident] = round((field.domain.hi[i] + 0.01) * 2**24)
        assert not evaluate(field_tables, moved)[1][evaluator.FLAGS] & evaluator.IN_DOMAIN
    # inside the box, against the features' correlation
    inside = list(row)
    for i, ident in enumerate(compiler.feature_ids(field.features)):
        inside[ident] = round((field.domain.hi[i] if i % 2 else field.domain.lo[i]) * 2**24)
    out = evaluate(field_tables, inside)[1]
    assert not out[evaluator.FLAGS] & evaluator.IN_DOMAIN and out[evaluator.DISTANCE] > 1000


RANGED = [(0, 0), (0, 1), (2, 0), (2, 1), (3, 0), (3, 1), (4, 1)]


@pytest.mark.parametrize(("output", "side"), RANGED)
def test_an_estimate_beyond_its_range_by_more_than_the_margin_is_out_of_domain(field, output, side):
    """The range's end is moved to either side of where a stroke's estimate is just let through."""
    row = accuracy_inputs(field, 1)[0]
    features = [row[ident] / 2**24 for ident in compiler.feature_ids(field.features)]
    ranges = [(None, None)] * evaluator.OUTPUTS
    margin = round(0.15 * 256) / 256
    open_ended = dataclasses.replace(field.domain, ranges=tuple(ranges), margin=margin)
    said = reference.evaluate(dataclasses.replace(field, domain=open_ended), np.array([features]))
    y = said["y"][0, output]
    hard = int(said["value"][0, 4] < field.hard_below)
    half = said["sigma"][0, output] * field.interval.quantiles[output][hard]
    for step, inside in ((-1e-5, False), (1e-5, True)):
        # `side` 0: the lower end, just above or below y + margin; 1: the upper end
        end = y + (1 - 2 * side) * (margin * half - step)
        end = float(end if field.outputs[output].link == "identity" else np.exp(end))
        ranges[output] = (end, None) if side == 0 else (None, end)
        domain = dataclasses.replace(field.domain, ranges=tuple(ranges), margin=margin)
        spec = dataclasses.replace(field, domain=domain).validate()
        flags = evaluate(compiler.compile_model(spec), row)[1][evaluator.FLAGS]
        assert bool(flags & evaluator.IN_DOMAIN) is inside
        assert bool(reference.evaluate(spec, np.array([features]))["in_domain"][0]) is inside


def test_the_domain_flag_is_the_same_in_integers_and_in_float64_wherever_the_estimates_lie():
    """Ranges so narrow that half of the strokes lie beyond them, and by every output."""
    spec = synthetic.model("field")
    ranges = ((40.0, 90.0), (8.0, 20.0), (6.0, 14.0), (0.45, 1.1), (0.15, 0.85), (None, None))
    domain = dataclasses.replace(spec.domain, ranges=((None, None),) * evaluator.OUTPUTS)
    features = sampling.in_domain(dataclasses.replace(spec, domain=domain), 3000)
    spec = dataclasses.replace(spec, domain=dataclasses.replace(spec.domain, ranges=ranges)).validate()
    said = reference.evaluate(spec, features)
    assert 0.2 < said["in_domain"].mean() < 0.8
    got = accuracy.run(spec, compiler.compile_model(spec), features)[:, evaluator.FLAGS]
    assert np.mean((got & evaluator.IN_DOMAIN > 0) == said["in_domain"]) > 0.999  # the rest sit on a limit
