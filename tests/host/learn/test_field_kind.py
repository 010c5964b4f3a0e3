"""The field kind on a small set of committed strokes: honest splits, and intervals that cover."""

import json
import shutil

import numpy as np
import pytest

from palpate.learn import data, design, lumps, model, ridge, scopes
from palpate.learn.cylinders import fit_to_cylinders
from palpate.learn.model import learn_force_map
from palpate.learn.observed import observe
from palpate.learn.probe_model import E_INV23, from_link, training_hash
from palpate.learn.table import TableError
from palpate.model_export import exporter
from palpate.model_export import image_builder as image
from palpate.model_export.integers.reference import evaluate, monomials
from palpate.model_export.schema import ModelSpec
from palpate.report import held_out_figures
from palpate.sim.tissue import Case
from tests.host.learn.conftest import SMALL, STROKES
from tests.studies.retrained import row_of


def test_the_same_seed_gives_the_same_strokes_and_another_seed_others(bench):
    some = [lump.field for lump in bench.test[:2]]
    a, b, c = (observe(some, "typical", seed) for seed in (5, 5, 6))
    assert np.array_equal(a.X, b.X) and not np.array_equal(a.X, c.X)


def test_a_small_field_model_holds_on_lumps_it_never_saw(fitted, parts):
    found, _ = row_of("small", fitted, parts[2])
    assert found["t_r2"] > 0.97 and found["d_r2"] > 0.8 and found["h_r2"] > 0.8
    assert found["hard_soft"] > 0.75


def test_moving_frames_to_the_mean_force_is_what_makes_it_hold(bench, parts, fitted):
    """Without the force map the hand's wandering turns into ripple of the map (FACTS, "The sensor")."""
    train, _, test = bench.parts(bench.noise, force_map=None)
    poor, _ = row_of("bare", model.fit_model(SMALL, train), test)
    good, _ = row_of("moved", fitted, parts[2])
    assert good["d_error"] < 0.7 * poor["d_error"]


def test_the_written_model_says_what_the_fitted_one_says(fitted, parts, bench, tmp_path):
    """ModelSpec through model.json, evaluated as the compiler does it, against the model that was scored."""
    spec = fitted.spec(
        {"hash": training_hash(parts[0].X, parts[1].X), "n": 1}, learn_force_map(bench.train).as_dict()
    )
    spec.save(tmp_path / "model.json")
    read = ModelSpec.load(tmp_path / "model.json")
    test = parts[2]
    answers, said = fitted.answer(test), evaluate(read, test.features(read.features))
    low, high = (
        np.clip(answers.y + way * answers.half, fitted.polynomial.lo, fitted.polynomial.hi) for way in (-1, 1)
    )
    for part, ours in (("value", answers.y), ("low", low), ("high", high)):
        assert said[part][:, :-1] == pytest.approx(from_link(ours))
        assert said[part][:, -1] == pytest.approx(10.0), "it was told the fat"
    assert said["in_domain"].tolist() == answers.in_domain.tolist()
    sure_hard, sure_soft = high[:, E_INV23] < fitted.border, low[:, E_INV23] >= fitted.border
    assert ((said["hardness"] == "hard") == sure_hard).all()
    assert ((said["hardness"] == "soft") == sure_soft).all()


def test_plain_tissue_is_no_lump(bench):
    assert bench.felt(bench.strokes.plain, bench.noise, 400).found.mean() < 0.05


def test_the_whole_fit_is_one_json_document_that_names_what_it_left_out(strokes):
    said: list[tuple[str, int, int]] = []
    result = fit_to_cylinders(
        strokes, others=(), scope=scopes.TOLD, progress=lambda *words: said.append(words)
    )
    document = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    (row,) = document["held_out"]
    assert row["setting"] == "typical, one stroke" and set(result.study.seen.group) <= set(range(96))
    every = sum(cell["n"] for cell in document["detectability"])
    assert every - document["excluded"]["no lump found"] == row["n"]
    assert {"false_alarms", "flagged_inside", "strange"} <= set(document)
    assert len(result.tables()) == 6
    for item in held_out_figures.items(result):
        assert item.draw().axes and item.tables
    assert said[-1][1] == said[-1][2], "progress ends where it said that it would"
    spec = result.spec
    assert spec.force_map is not None and spec.training["noise"] == "typical"
    assert spec.first is None and "tissue" not in spec.training, "it is told, and estimates none"
    assert [e.name for e in spec.checks.estimates] == ["two_lumps", "softer", "stiffer"]
    # Whatever it was fitted to, the image with its checks has room beside a signature of 7,856 bytes.
    prepared, _, force_map = exporter.prepare(spec)
    assert len(image.build(spec, prepared, force_map, counter=1)) < 8000


def test_strokes_without_a_partner_are_counted_not_used(strokes):
    lump = strokes.lumps[0]
    found, alone = lumps.by_lump([lump.low, strokes.lumps[1].low, lump.high])
    assert len(found) == 1 and alone == [strokes.lumps[1].low.code]
    assert found[0].case.F_rel == pytest.approx(lump.low.case.F_rel * 1.4**0.5)


def test_the_forces_of_a_lump_are_found_again_whatever_their_order(strokes):
    low, middle, high = strokes.lumps[0].strokes
    ((lump,), alone) = lumps.by_lump([high, low, middle])
    assert lump.strokes == (low, middle, high) and not alone
    assert lump.case.F_rel == pytest.approx(middle.case.F_rel)


def test_an_empty_directory_is_refused_in_one_sentence(tmp_path):
    with pytest.raises(TableError, match="no strokes over lumps"):
        data.read_strokes(tmp_path)
    with pytest.raises(ValueError, match="no noise level 'awful'"):
        observe([], "awful", 1)


def test_strokes_over_another_tissue_are_not_fitted_to_in_silence():
    with pytest.raises(TableError, match="gland_ratio 6, not 8; name another directory"):
        data.prepare_strokes(STROKES, scope=scopes.told({"gland_ratio": 8.0}))
    assert data.prepare_strokes(STROKES, scope=scopes.TOLD).lumps


def test_strokes_of_an_older_release_are_refused_in_one_sentence(tmp_path):
    """It simulated no presses for a model that is told its tissue."""
    shutil.copytree(STROKES / "lumps", tmp_path / "lumps")
    with pytest.raises(TableError, match="strokes without their presses; name another directory"):
        data.prepare_strokes(tmp_path, scope=scopes.TOLD)


def test_the_design_fills_the_range_and_no_lump_cases_have_none():
    cases = design.lump_cases(32, 1, {})
    forces = [case.F_rel for case in cases]
    assert len(cases) == 32 and min(forces) >= 0.3 and max(forces) <= 1.0
    assert {c.gland_ratio for c in design.lump_cases(4, 1, {"gland_ratio": 4.0})} == {4.0}
    assert not any(map(design.inside, design.rim_cases(8, 1, {})))
    plain = design.no_lump_cases(16, 2, {})
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


def test_cubic_terms_are_kept_by_what_they_are_worth():
    rng = np.random.default_rng(6)
    z = rng.uniform(-1, 1, (600, 4))
    small = scopes.Recipe("small", ("a", "b", "c", "d"), 2, cubic=("a", "b", "c", "d"), most=17)
    Y = z[:, :1] + 0.5 * (z[:, 0] * z[:, 1] * z[:, 2])[:, None] + 0.5 * z[:, 3:] ** 3
    Y = np.hstack([Y + 0.01 * rng.normal(size=Y.shape), z[:, 1:2] ** 2])
    terms = small.terms(z, Y, np.arange(600) // 2)
    assert len(small.candidates()) == 35 and len(terms) == 17
    assert set(terms[15:]) == {(0, 1, 2), (3, 3, 3)}
