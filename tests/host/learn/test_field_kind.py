"""The field kind on a small set of committed strokes: honest splits, and intervals that cover."""

import dataclasses
import json

import numpy as np
import pytest

from palpate.learn import bench as benches
from palpate.learn import data, design, lumps, model, ridge, scopes, score, told
from palpate.learn.observed import observe
from palpate.learn.probe_model import training_hash
from palpate.learn.table import TableError
from palpate.model_export import exporter
from palpate.model_export import image_builder as image
from palpate.model_export.integers.reference import evaluate, monomials
from palpate.model_export.schema import ModelSpec
from palpate.report import held_out_figures
from palpate.sim.tissue import Case
from tests.host.learn.conftest import STROKES
from tests.host.learn.made_up import made_up

SIGNATURE = 900
"""Bytes, by the key that `palpate keygen` makes if nothing is said."""


def test_no_lump_is_in_two_parts_and_none_is_lost():
    parts = data.split(101)
    together = np.concatenate([parts.train, parts.calibration, parts.test])
    assert sorted(together) == list(range(101))
    assert data.split(101).test.tolist() == parts.test.tolist(), "the split is the same every time"
    assert data.split(101, seed=2).test.tolist() != parts.test.tolist()


def test_test_lumps_are_never_fitted_to(bench, parts):
    train, calibration, test, _ = parts
    assert not set(test.group) & (set(train.group) | set(calibration.group))
    assert not set(train.group) & set(calibration.group)


def test_the_same_seed_gives_the_same_strokes_and_another_seed_others(bench):
    some = bench.lumps[:2]
    a, b, c = (observe(some, "typical", seed) for seed in (5, 5, 6))
    assert np.array_equal(a.X, b.X) and not np.array_equal(a.X, c.X)


def test_a_small_field_model_holds_on_lumps_it_never_saw(fitted, parts):
    answers = fitted.answer(parts[2])
    found = score.scores(parts[2], answers.value, answers.found)
    assert found["t_r2"] > 0.97 and found["d_r2"] > 0.8 and found["h_r2"] > 0.8
    assert found["hard_soft_far"] > 0.75


def test_moving_frames_to_the_mean_force_is_what_makes_it_hold(bench, parts, fitted):
    """Without the force map the hand's wandering turns into ripple of the map (FACTS, "The sensor")."""
    bare = scopes.Recipe("bare", scopes.PILOT_FEATURES, 1, force_map=False)
    train, calibration, test, _ = bench.parts("typical", bare, draws=(2, 2, 2))
    poor = model.fit_model(scopes.TOLD.of(bare), train, calibration).answer(test)
    good = fitted.answer(parts[2])
    with_map = score.scores(parts[2], good.value, good.found)["d_error"]
    assert with_map < 0.7 * score.scores(test, poor.value, poor.found)["d_error"]


def test_the_written_model_says_what_the_fitted_one_says(fitted, parts, bench, tmp_path):
    """ModelSpec through model.json, evaluated as the compiler does it, against the model that was scored."""
    spec = fitted.spec({"hash": training_hash(parts[0].X, parts[1].X), "n": 1}, bench.force_map.as_dict())
    spec.save(tmp_path / "model.json")
    read = ModelSpec.load(tmp_path / "model.json")
    test = parts[2]
    answers, said = fitted.answer(test), evaluate(read, test.features(read.features))
    for part in ("value", "low", "high"):
        assert said[part][:, :-1] == pytest.approx(getattr(answers, part))
        assert said[part][:, -1] == pytest.approx(10.0), "it was told the fat"
    assert said["in_domain"].tolist() == answers.in_domain.tolist()
    assert said["hardness"].tolist() == answers.hardness.tolist()


def test_plain_tissue_is_no_lump(bench, fitted):
    observed = bench.observe(bench.plain, np.arange(len(bench.plain)), "typical", 2, 400)
    assert observed.found.mean() < 0.05


def test_the_whole_fit_is_one_json_document_that_names_what_it_left_out(strokes):
    said: list[tuple[str, int, int]] = []
    result = told.fit_field(strokes, levels=(), progress=lambda *words: said.append(words))
    document = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    left_out = {why: n for why, n in document["excluded"].items() if why.startswith("test")}
    test_strokes = len(result.test)
    one = next(row for row in document["held_out"] if row["strokes"] == 1)
    assert one["n"] + sum(left_out.values()) == test_strokes
    assert {"false_alarms", "flagged_inside", "decided", "E_is_a_bound"} <= set(document)
    assert len(result.tables()) == 7
    for item in held_out_figures.items(result):
        assert item.draw().axes and item.tables
    done = {what: (n, of) for what, n, of in said}
    assert {"strokes observed through the sensors", "terms chosen", "models fitted", "models scored"} == set(
        done
    )
    assert all(n == of for n, of in done.values())
    assert result.spec.force_map is not None and result.spec.training["noise"] == "typical"
    # Whatever it was fitted to, the recipe's image has room in the probe's slot and on slow links.
    prepared, _, force_map = exporter.prepare(result.spec)
    assert len(image.build(result.spec, prepared, force_map, counter=1)) + SIGNATURE < 8000


def test_strokes_without_a_partner_are_counted_not_used(strokes):
    lump = strokes.lumps[0]
    found, alone = lumps.by_lump([lump.low, strokes.lumps[1].low, lump.high])
    assert len(found) == 1 and alone == [strokes.lumps[1].low.code]
    assert found[0].case.F_rel == pytest.approx(lump.low.case.F_rel * 1.4**0.5)


def test_the_forces_of_a_lump_are_found_again_whatever_their_order(strokes):
    case = strokes.lumps[0].case
    low, middle, high = (dataclasses.replace(strokes.lumps[0].low, case=c) for c in design.at_forces(case))
    ((lump,), alone) = lumps.by_lump([high, low, middle])
    assert lump.strokes == (low, middle, high) and not alone
    assert lump.case.F_rel == pytest.approx(middle.case.F_rel)


def test_an_empty_directory_is_refused_in_one_sentence(tmp_path):
    with pytest.raises(TableError, match="no strokes over lumps at two forces"):
        data.read(tmp_path)
    with pytest.raises(ValueError, match="no noise level 'awful'"):
        observe([], "awful", 1)


def test_strokes_over_another_tissue_are_not_fitted_to_in_silence():
    with pytest.raises(TableError, match="gland_ratio 6, not 8; name another directory"):
        data.prepare(STROKES, rim=0, wide=0, tissue={"gland_ratio": 8.0})
    assert data.prepare(STROKES, rim=0, wide=0).lumps


def test_the_design_fills_the_range_and_no_lump_cases_have_none():
    cases = design.lump_cases(32)
    assert len(cases) == 96
    mean = [case.F_rel for case in cases[1::3]]
    assert np.sqrt([a.F_rel * b.F_rel for a, b in zip(cases[::3], cases[2::3])]) == pytest.approx(mean)
    assert min(mean) >= 0.3 and max(mean) <= 1.0
    assert {c.gland_ratio for c in design.lump_cases(4, tissue={"gland_ratio": 4.0})} == {4.0}
    plain = design.no_lump_cases(16)
    assert not any(c.has_lump for c in plain) and all(3.9 < c.t_mm < 40.1 for c in plain)
    assert not design.inside(Case(25.0, 0.8, 10.0)) and design.inside(Case(15.0, 0.8, 10.0))


def test_ridge_finds_a_polynomial_and_judges_on_whole_lumps():
    rng = np.random.default_rng(2)
    z = rng.uniform(-1, 1, (400, 3))
    terms = ridge.all_terms(3, 3)
    assert len(terms) == 20 and terms[0] == ()
    A = monomials(z, terms)
    assert A[:, terms.index((0, 0, 2))] == pytest.approx(z[:, 0] ** 2 * z[:, 2])
    truth = rng.normal(size=(20, 2))
    found = ridge.fit_ridge(A, A @ truth, [len(t) for t in terms], np.arange(400) // 4)
    assert found.coefficients == pytest.approx(truth, abs=0.01)
    # Copies of a lump in every fold make noise look learnable; whole lumps do not.
    noise = np.repeat(rng.normal(size=(40, 1)), 10, axis=0)
    z = np.repeat(rng.uniform(-1, 1, (40, 3)), 10, axis=0)
    A = monomials(z, terms)
    honest = ridge.fit_ridge(A, noise, [len(t) for t in terms], np.arange(400) // 10)
    fooled = ridge.fit_ridge(A, noise, [len(t) for t in terms], np.arange(400))
    assert fooled.error[0] < honest.error[0]


def test_strokes_seen_by_many_processes_are_those_seen_by_one(bench, strokes, monkeypatch):
    some = np.arange(8)
    observed = bench.observe(bench.lumps, some, "typical", 2, 3)
    monkeypatch.setattr(benches, "WORTH_A_POOL", 1)
    with benches.Bench(strokes, workers=2) as two:
        together = two.observe(two.lumps, some, "typical", 2, 3)
        assert "_pool" in vars(two)
    assert np.array_equal(observed.X, together.X) and observed.group.tolist() == [*some, *some]


def test_cubic_terms_are_kept_by_what_they_are_worth():
    rng = np.random.default_rng(6)
    z = rng.uniform(-1, 1, (600, 4))
    small = scopes.Recipe("small", ("a", "b", "c", "d"), 2, cubic=("a", "b", "c", "d"), most=17)
    Y = z[:, :1] + 0.5 * (z[:, 0] * z[:, 1] * z[:, 2])[:, None] + 0.5 * z[:, 3:] ** 3
    Y = np.hstack([Y + 0.01 * rng.normal(size=Y.shape), z[:, 1:2] ** 2])
    terms = small.terms(z, Y, np.arange(600) // 2)
    assert len(small.candidates()) == 35 and len(terms) == 17
    assert set(terms[15:]) == {(0, 1, 2), (3, 3, 3)}


def test_averaging_strokes_needs_the_lump_in_all_of_them():
    strokes = made_up(6, np.array([0, 0, 0, 1, 1, 1]))
    y = np.arange(30.0).reshape(6, 5)
    found = np.array([1, 1, 1, 1, 0, 1], bool)
    mean_observed, mean, lost = score.averaged(strokes, y, found, strokes=3)
    assert lost == 1 and mean_observed.group.tolist() == [0]
    assert mean[0] == pytest.approx(y[:3].mean(0))
