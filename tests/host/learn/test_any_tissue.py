"""Tissue that the probe knows nothing about: one simulation for every fat, a press that tells the tissue."""

import numpy as np
import pandas as pd
import pytest

from firmware_py import geometry
from palpate.errors import UsageError
from palpate.learn import cylinders, lumps, model, observed, scopes, strange, study
from palpate.learn.observed import NAMES
from palpate.sim.probe.sensors import PRESS_FRAMES, Noise, SensorModel, StrokeField
from palpate.sim.tissue import Case, Settings, simulate_forces
from palpate.sim.tissue.any_tissue import PRESS_PARTS, PRESSES, any_tissue_cases, press_cases
from palpate.sim.tissue.design import read_design, settings_of
from tests.firmware_py import press_float
from tests.host.learn.made_up import made_up, smooth
from tests.studies import any_tissue as any_tissue_study

CASE = Case(12.0, 0.7, 20.0, 0.5, gland_ratio=4.0, gland_mm=12.0, fat_stiffening=1.0)


@pytest.fixture(scope="module")
def few(tmp_path_factory):
    """Two lumps of the design, simulated."""
    return any_tissue_study.prepare(tmp_path_factory.mktemp("any"), 2, workers=1)


def test_the_design_draws_tissue_and_face_and_a_longer_one_begins_with_the_shorter():
    cases = any_tissue_cases(16, 5)
    assert len(cases) == 48 and cases[:24] == any_tissue_cases(8, 5)
    for low, middle, high in zip(cases[::3], cases[1::3], cases[2::3], strict=True):
        assert high.F_rel / low.F_rel == pytest.approx(1.4)
        assert 2.5 <= middle.F_N_per_m / middle.fat_kPa <= 12.0
        assert 1 <= middle.gland_ratio <= 10 and 8 <= middle.gland_mm <= 30
        assert 38 <= middle.probe_radius_mm <= 42 and 0 <= middle.fat_stiffening <= 3
    hardest = press_cases(16, 5)[len(PRESS_PARTS) - 1]
    assert hardest.F_rel == pytest.approx(cases[1].F_rel) and hardest.d_mm == cases[1].d_mm


def test_the_command_line_names_both_designs_and_presses_without_a_stroke():
    assert read_design("any:3:7") == any_tissue_cases(3, 7)
    assert read_design("any-press:3:7") == press_cases(3, 7)
    assert list(settings_of("any-press:3", 2.0).positions_mm()) == [-40.0]
    assert settings_of("any:3", 1.0).positions_mm()[0] == -44.0 and settings_of("any:3", 1.0).hx_mm == 1.0
    assert settings_of("sobol:3", 2.0) == Settings()


def test_one_simulation_serves_every_fat():
    (stroke,) = simulate_forces(CASE, [CASE.F_rel], positions_mm=[-28.0, -26.0])
    other = lumps.scaled(stroke, 1.7)
    (computed,) = simulate_forces(other.case, [other.case.F_rel], positions_mm=[-28.0, -26.0])
    assert computed.displacement_mm == pytest.approx(stroke.displacement_mm, rel=1e-4)
    assert computed.images_kPa == pytest.approx(other.images_kPa, rel=1e-3, abs=1e-3)


def test_a_press_is_felt_at_parts_of_the_strokes_force():
    forces = [CASE.F_rel * part for part in (0.2, 0.4, 0.65, 1.0)]
    field = StrokeField(*simulate_forces(CASE, forces, PRESSES))
    F = CASE.F_N_per_m
    sensors = SensorModel(field, Noise(quantise=False), 1, mean_force_N_per_m=F)
    stream = sensors.stroke(2, press=PRESS_FRAMES, pressed=field)
    counts, depths_mm = stream.counts[:PRESS_FRAMES], stream.displacements_um[:PRESS_FRAMES] / 1e3
    frames = press_float.curves(counts, depths_mm)
    found = press_float.at_parts(frames, np.log(F))
    images, depths = field.at(np.zeros(3), F * np.array(press_float.PARTS))
    assert found[:3] == pytest.approx(np.log(depths), abs=0.02)
    share = np.log(images[:, 6:10].mean(1) / images.mean(1))
    assert found[6:9] == pytest.approx(share, abs=0.02)
    # in plane strain all columns read alike; at light forces a parabola of the share itself bends too little
    assert found[9:] == pytest.approx(np.exp(share), rel=0.12)
    assert frames[-1, 0] == pytest.approx(np.log(images[-1].sum() * 1.5), abs=0.005)


def test_below_the_least_force_that_was_simulated_a_pressed_image_keeps_its_shape():
    low, high = (CASE.F_rel * part for part in (0.8, 1.0))
    field = StrokeField(*simulate_forces(CASE, [low, high], PRESSES))
    sensors = SensorModel(field, Noise(quantise=False), 1, mean_force_N_per_m=CASE.F_N_per_m)
    stream = sensors.stroke(2, press=20)
    rows = stream.counts[:20] - geometry.PEDESTAL_COUNTS
    assert rows.mean(1) == pytest.approx(rows[-1].mean() * np.linspace(0.2, 1, 20), rel=0.01)
    assert (np.diff(stream.displacements_um[:21]) >= -1).all() and len(set(stream.positions_um[:21])) == 1


def test_strokes_are_seen_with_their_press_each_in_a_fat_of_its_own(few):
    one, again, other = (observed.observe_in_any_fat(few, "typical", seed, None) for seed in (1, 1, 2))
    assert np.array_equal(one.X, again.X) and np.array_equal(one.press, again.press)
    assert not np.array_equal(one.of("ln E_fat"), other.of("ln E_fat"))
    fat, force = np.exp(one.of("ln E_fat")), np.exp(one.of("ln F"))
    assert ((fat > 4.9) & (fat < 25.1)).all() and ((force > 22) & (force < 170)).all()
    assert one.of("ln F/E_fat") == pytest.approx(one.of("ln F") - one.of("ln E_fat"))
    assert np.isfinite(one.press).all() and one.X[:, NAMES.index("ln_force")] == pytest.approx(
        one.of("ln F"), abs=0.08
    )


def test_sweeps_of_other_lumps_have_nothing_in_common(few, tmp_path):
    with pytest.raises(UsageError, match="no lump in common"):
        lumps.read_pressed(*made_apart(few, tmp_path))


def made_apart(few, home):
    from palpate.sim.tissue import sweep

    lump = few[0].strokes[0].case
    cases = [Case(lump.d_mm, lump.h, 2.0, f) for f in (0.3, 0.42)]
    sweep(cases, Settings(start_mm=0.0), home / "lumps", workers=1)
    sweep(press_cases(1, 99), PRESSES, home / "press", workers=1)
    return home / "lumps", home / "press"


def test_two_stages_learn_from_lumps_and_cover_those_left_out():
    seen = smooth(120, 2, np.random.default_rng(3))
    result = study.Study.held_out(seen, folds=3)
    row = result.row("made up")
    assert len(result.y) == len(seen) and row["lumps"] == 120
    assert row["E_fat_r2"] > 0.98 and row["d_r2"] > 0.9
    assert 0.8 < row["d_covered"] < 0.98 and 0.8 < row["E_fat_covered"] < 0.99
    heads, rows = study.text_of(pd.DataFrame([row]))
    assert len(heads) == len(rows[0]) == len(rows[1]) and rows[0][0] == "wanted"


def test_the_tissue_is_known_from_the_press_before_the_stroke():
    seen = smooth(150, 1, np.random.default_rng(4))
    fitted, guessed = model.fit_press(seen)
    true = model.tissue_truth(seen)
    assert np.sqrt(((guessed - true)[:, 0] ** 2).mean()) < 0.02
    assert model.said_by_press(fitted, seen.press).shape == (150, 3)
    assert len(fitted.terms) == model.PRESS_TERMS


def test_no_lump_that_judges_the_flag_was_trained_on(monkeypatch):
    """All of them were in both parts, and no test noticed."""
    seen = made_up(30, np.arange(30))
    monkeypatch.setattr(cylinders, "beyond", lambda seen, _scope: np.zeros(len(seen)))
    trained, judging = cylinders._rim(seen, scopes.BORDER)
    assert not set(trained.group.tolist()) & set(judging.group.tolist())
    assert {*trained.group.tolist(), *judging.group.tolist()} == set(range(30))
    assert len(set(judging.group.tolist())) == 10


def test_no_lump_that_judges_the_checks_had_a_part_in_them_or_in_their_model(monkeypatch):
    seen, pairs = (smooth(20, 2, np.random.default_rng(seed)) for seed in (5, 6))
    met = set()

    def fitted(_scope, train, **_):
        met.update(train.group.tolist())

    def checks(_model, own, others):
        met.update(own.group.tolist(), *(other.group.tolist() for other in others.values()))

    monkeypatch.setattr(strange, "fit_model", fitted)
    monkeypatch.setattr(strange, "strange_checks", checks)
    monkeypatch.setattr(strange, "replace", lambda model, **_: model)
    monkeypatch.setattr(strange, "strange_rows", lambda _model, own, *_, **__: own)
    judging = set(strange.strange_table([], [], seen, None, None, {"two_lumps": pairs}).group.tolist())
    assert not met & judging and met | judging == set(range(20)) and len(judging) == 7
