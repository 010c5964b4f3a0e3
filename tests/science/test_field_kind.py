"""The field kind on a small set of committed strokes: honest splits, and intervals that cover."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.regression import conformal, domain, ridge
from host.regression.field import data, design, fit, model, recipe, score
from host.regression.field.bench import Bench
from host.regression.field.study import STUDIES, study_table
from host.regression.seen import Seen, look
from host.regression.table import TableError
from host.report.study_figures import save_study_figure
from model_export.reference import evaluate
from model_export.schema import ModelSpec
from sim.tissue import Case

STROKES = Path(__file__).parent / "data"
SMALL = recipe.Recipe("field", recipe.R11, 1)


@pytest.fixture(scope="module")
def strokes():
    """96 lumps and 24 plain tissues, each at two forces (made by `python -m tests.science.make_data`)."""
    return data.read(STROKES)


@pytest.fixture(scope="module")
def bench(strokes):
    return Bench(strokes)


@pytest.fixture(scope="module")
def parts(bench):
    return bench.parts("typical", draws=(2, 2, 2))


@pytest.fixture(scope="module")
def fitted(parts):
    return model.fit_field_model(SMALL, parts[0], parts[1])


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
    a, b, c = (look(some, "typical", seed) for seed in (5, 5, 6))
    assert np.array_equal(a.X, b.X) and not np.array_equal(a.X, c.X)


def test_a_small_field_model_holds_on_lumps_it_never_saw(fitted, parts):
    answers = fitted.answer(parts[2])
    found = score.scores(parts[2], answers.value, answers.lump)
    assert found["t_r2"] > 0.97 and found["d_r2"] > 0.8 and found["h_r2"] > 0.8
    assert found["hard_soft_far"] > 0.8


def test_moving_frames_to_the_mean_force_is_what_makes_it_hold(bench, parts):
    """Without the force map the hand's wandering turns into ripple of the map (FACTS, "The sensor")."""
    bare = recipe.Recipe("bare", recipe.R11, 1, force_map=False)
    train, calibration, test, _ = bench.parts("typical", False, draws=(2, 2, 2))
    poor = model.fit_field_model(bare, train, calibration).answer(test)
    good = model.fit_field_model(SMALL, parts[0], parts[1]).answer(parts[2])
    with_map = score.scores(parts[2], good.value, good.lump)["d_error"]
    assert with_map < 0.7 * score.scores(test, poor.value, poor.lump)["d_error"]


def test_the_written_model_says_what_the_fitted_one_says(fitted, parts, bench, tmp_path):
    """ModelSpec through model.json, evaluated as the compiler does it, against the model that was scored."""
    spec = fitted.spec({"hash": model.hash_of(parts[0], parts[1]), "n": 1}, bench.force_map.as_dict())
    spec.save(tmp_path / "model.json")
    read = ModelSpec.load(tmp_path / "model.json")
    test = parts[2]
    answers, said = fitted.answer(test), evaluate(read, test.columns(read.features))
    assert said["value"] == pytest.approx(answers.value)
    assert said["low"] == pytest.approx(answers.low) and said["high"] == pytest.approx(answers.high)
    assert said["in_domain"].tolist() == answers.in_domain.tolist()
    assert said["hardness"].tolist() == answers.hardness.tolist()


def test_plain_tissue_is_no_lump(bench, fitted):
    seen = bench.see(bench.plain, np.arange(len(bench.plain)), "typical", 2, 400)
    assert not seen.lump.any()
    assert fitted.lump(seen).mean() < 0.05


def test_the_whole_fit_is_one_json_document_that_names_what_it_left_out(strokes):
    said: list[tuple[str, int, int]] = []
    result = fit.fit_field(strokes, levels=(), recipes=(), watch=lambda *words: said.append(words))
    document = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    left_out = {why: n for why, n in document["excluded"].items() if why.startswith("test")}
    test_strokes = len(result.test)
    one = next(row for row in document["held_out"] if row["strokes"] == 1)
    assert one["n"] + sum(left_out.values()) == test_strokes
    assert {"false_alarms", "flagged_inside", "decided", "E_is_a_bound"} <= set(document)
    assert len(result.tables()) == 6
    done = {what: (n, of) for what, n, of in said}
    assert {"strokes seen through the sensors", "terms chosen", "models fitted", "models scored"} == set(done)
    assert all(n == of for n, of in done.values())
    assert result.spec.force_map is not None and result.spec.training["noise"] == "typical"


def test_strokes_without_a_partner_are_counted_not_used(strokes):
    pair = strokes.lumps[0]
    pairs, alone = design.pairs_of([pair.low, strokes.lumps[1].low, pair.high])
    assert len(pairs) == 1 and alone == [strokes.lumps[1].low.code]
    assert pairs[0].case.F_rel == pytest.approx(pair.low.case.F_rel * 1.4**0.5)


def test_an_empty_directory_is_refused_in_one_sentence(tmp_path):
    with pytest.raises(TableError, match="no strokes in pairs"):
        data.read(tmp_path)
    with pytest.raises(ValueError, match="no noise level 'awful'"):
        look([], "awful", 1)


def test_the_design_fills_the_range_and_no_lump_cases_have_none():
    cases = design.lump_cases(32)
    assert len(cases) == 64
    mean = [np.sqrt(a.F_rel * b.F_rel) for a, b in zip(cases[::2], cases[1::2])]
    assert min(mean) >= 0.3 and max(mean) <= 1.0
    assert {c.gland_ratio for c in design.lump_cases(4, tissue={"gland_ratio": 4.0})} == {4.0}
    plain = design.no_lump_cases(16)
    assert not any(c.has_lump for c in plain) and all(3.9 < c.t_mm < 40.1 for c in plain)
    assert not design.inside(Case(25.0, 0.8, 10.0)) and design.inside(Case(15.0, 0.8, 10.0))


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10**6))
def test_intervals_cover_what_they_promise_where_the_noise_changes(seed):
    """Ninety percent overall and in the quiet and the loud half, though the noise changes fivefold."""
    rng = np.random.default_rng(seed)
    n = 16000
    z = rng.uniform(-1, 1, (n, 2))
    loud = np.exp(0.8 * z[:, 0])
    predicted = z @ np.ones((2, 1))
    truth = predicted + loud[:, None] * 0.1 * rng.standard_normal((n, 1))
    fit_rows, calibrate_rows, test_rows = np.split(np.arange(n), [4000, 10000])
    terms, sigma = conformal.fit_sigma(
        z[fit_rows], predicted[fit_rows], (truth - predicted)[fit_rows], fit_rows
    )
    hard = z[:, 1] > 0
    widths = conformal.calibrate(
        terms,
        sigma,
        z[calibrate_rows],
        predicted[calibrate_rows],
        truth[calibrate_rows],
        hard[calibrate_rows],
    )
    half = widths.half(z[test_rows], predicted[test_rows], hard[test_rows])
    inside = (np.abs(truth - predicted)[test_rows] <= half)[:, 0]
    assert inside.mean() == pytest.approx(0.9, abs=0.03)
    for part in (z[test_rows, 0] < 0, z[test_rows, 0] >= 0):
        assert inside[part].mean() == pytest.approx(0.9, abs=0.05)


def test_the_conformal_quantile_is_the_right_order_statistic():
    scores = np.arange(1.0, 100.0)
    assert conformal.conformal_quantile(scores, 0.9) == 90.0
    assert conformal.conformal_quantile(np.array([]), 0.9) == 0.0


def test_ridge_finds_a_polynomial_and_judges_on_whole_lumps():
    rng = np.random.default_rng(2)
    z = rng.uniform(-1, 1, (400, 3))
    terms = ridge.all_terms(3, 3)
    assert len(terms) == 20 and terms[0] == ()
    A = ridge.monomials(z, terms)
    assert A[:, terms.index((0, 0, 2))] == pytest.approx(z[:, 0] ** 2 * z[:, 2])
    truth = rng.normal(size=(20, 2))
    found = ridge.fit_ridge(A, A @ truth, [len(t) for t in terms], np.arange(400) // 4)
    assert found.coefficients == pytest.approx(truth, abs=0.01)
    # Copies of a lump in every fold make noise look learnable; whole lumps do not.
    noise = np.repeat(rng.normal(size=(40, 1)), 10, axis=0)
    z = np.repeat(rng.uniform(-1, 1, (40, 3)), 10, axis=0)
    A = ridge.monomials(z, terms)
    honest = ridge.fit_ridge(A, noise, [len(t) for t in terms], np.arange(400) // 10)
    fooled = ridge.fit_ridge(A, noise, [len(t) for t in terms], np.arange(400))
    assert fooled.error[0] < honest.error[0]


def test_the_domain_flags_what_is_far_and_little_of_what_is_near():
    rng = np.random.default_rng(4)
    mix = rng.normal(size=(3, 3))
    z = rng.normal(size=(3000, 3)) @ mix
    check = domain.fit_domain(z, z, share_out=0.02)
    fresh = rng.normal(size=(3000, 3)) @ mix
    assert (~check.familiar(fresh, fresh)).mean() < 0.04
    far = fresh + 20 * mix[0]
    assert (~check.familiar(far, far)).mean() > 0.99
    # each feature in range, their combination not
    odd = np.linalg.svd(z - z.mean(0), full_matrices=False)[2][-1:] * np.abs(z).max() * 0.9
    assert not check.familiar(odd, odd).any()


def test_the_margin_lets_through_as_many_inside_strokes_as_it_is_asked_to():
    rng = np.random.default_rng(5)
    n, half = 40000, 0.05
    truth = rng.uniform(0, 1, (n, 2))
    y = truth + rng.normal(0, half / 1.645, (n, 2))
    z = rng.normal(size=(n, 2))
    check = domain.fit_domain(z, z, outputs=2, share_out=0.004)
    widths = np.full((n, 2), half)
    check = domain.with_ranges(
        check, np.zeros(2), np.array([1, np.inf]), check.familiar(z, z), y, widths, 0.02
    )
    assert (~check.inside(z, z, y, widths)).mean() == pytest.approx(0.02, abs=0.001)
    assert 0 < check.margin < 1
    # An estimate well beyond an end is flagged, one beyond where there is no end is not.
    far = np.array([[1 + 2 * half, 0.5], [0.5, 7.0], [0.5, -2 * half]])
    assert check.inside(z[:1].repeat(3, 0), z[:1].repeat(3, 0), far, widths[:3]).tolist() == [
        False,
        bool(check.familiar(z[:1], z[:1])[0]),
        False,
    ]


def test_averaging_strokes_needs_the_lump_in_all_of_them():
    Y = np.tile([50.0, 10.0, 10.0, 0.5, 0.2], (6, 1))
    group = np.array([0, 0, 0, 1, 1, 1])
    seen = Seen(np.zeros((6, 28)), np.zeros(6, int), Y, np.ones(6, bool), group)
    y = np.arange(30.0).reshape(6, 5)
    found = np.array([1, 1, 1, 1, 0, 1], bool)
    mean_seen, mean, lost = score.averaged(seen, y, found, strokes=3)
    assert lost == 1 and mean_seen.group.tolist() == [0]
    assert mean[0] == pytest.approx(y[:3].mean(0))


def test_a_study_retrains_for_each_setting_and_draws_one_figure(bench, tmp_path):
    study = STUDIES["pitch"]
    result = study.table(bench)
    assert list(result["setting"]) == ["1.5 mm (16 rows)", "3 mm (8 rows)"]
    assert result["d_error"].between(0, 0.2).all()
    heads, rows = study_table(study, result)
    assert len(heads) == len(rows[0]) == len(rows[1])
    save_study_figure(study, result, tmp_path / "pitch.svg")
    assert (tmp_path / "pitch.svg").read_text().count("3 mm (8 rows)") == 1


def test_fewer_bits_and_coarser_cells_change_what_the_pipeline_gets(bench):
    some = bench.lumps[:1]
    fine = look(some, "typical", 3)
    coarse = look(some, "typical", 3, alter=lambda counts: counts // 64 * 64 + 32)
    assert not np.array_equal(fine.X, coarse.X)
    assert coarse.columns(["ln_base"]) == pytest.approx(fine.columns(["ln_base"]), abs=0.05)
