"""A stroke gives what the thesis measures, and says so when it cannot."""

import dataclasses
import json
import math
import subprocess
import sys

import numpy as np
import pytest

from palpate.sim.tissue import (
    Case,
    CaseError,
    Settings,
    Stroke,
    StrokeError,
    predictor_kernels,
    simulate,
    simulate_forces,
)
from palpate.sim.tissue.frames import solve_frames
from palpate.sim.tissue.geometry import geometry_of
from palpate.sim.tissue.run import StrokeRun


@pytest.fixture(scope="module")
def reference() -> Stroke:
    return simulate(Case.from_code("d10h08e10f10"))


def test_the_reference_sinks_2_56_mm_and_presses_with_4_kPa(reference):
    assert reference.positions_mm[0] == -28
    assert reference.displacement_mm[0] == pytest.approx(2.56, rel=0.01)
    assert reference.images_kPa[0].mean() == pytest.approx(4.05, rel=0.01)
    assert reference.strain[0] == pytest.approx(0.197, abs=0.002)


def test_a_stroke_survives_json_and_stays_small(reference):
    text = json.dumps(reference.to_dict())
    again = Stroke.from_dict(json.loads(text))
    assert len(text) < 100_000
    assert again.case == reference.case
    np.testing.assert_array_equal(again.images_kPa, reference.images_kPa)
    np.testing.assert_array_equal(again.displacement_mm, reference.displacement_mm)


def test_the_full_stroke_is_its_own_mirror_image(reference):
    full = reference.full()
    assert len(full.positions_mm) == 29
    np.testing.assert_allclose(full.mirrored().images_kPa, full.images_kPa, atol=4e-3)  # the sides differ


def test_several_forces_agree_with_each_alone(reference):
    half, whole = simulate_forces(reference.case, [0.5, 1.0])
    assert half.F_N_per_m == 50
    np.testing.assert_allclose(whole.displacement_mm, reference.displacement_mm, rtol=1e-4)
    np.testing.assert_allclose(half.displacement_mm, simulate(half.case).displacement_mm, rtol=1e-4)


@pytest.mark.parametrize("code", ["d10h08e10f10", "d06h05e1000f11"])
def test_a_fine_mesh_is_pressed_with_less_work_to_the_same_state(code, monkeypatch):
    """On fine meshes pressing starts higher, and at first renews the tangent near the probe only."""
    case, settings, positions = Case.from_code(code), Settings(hx_mm=1.0), [-28.0, -26.0]
    sparing = simulate(case, settings, positions)
    monkeypatch.setattr(Settings, "fine", False)
    whole = simulate(case, settings, positions)
    assert sparing.factorisations <= whole.factorisations
    np.testing.assert_allclose(sparing.displacement_mm, whole.displacement_mm, rtol=1e-5)
    np.testing.assert_allclose(sparing.images_kPa, whole.images_kPa, atol=1e-5 * whole.images_kPa.max())


def test_a_probe_pressed_through_the_tissue_is_an_error_that_names_place_and_reason():
    with pytest.raises(StrokeError, match=r"failed at -28\.0 mm: pressing") as error:
        simulate(Case(10, 0.8, 10, F_rel=100), Settings(hx_mm=4.0))
    assert error.value.position_mm == -28


@pytest.mark.parametrize("positions", [[], [1, 0], [float("nan")], [-90, 0]])
def test_positions_that_make_no_sense_are_refused(positions):
    with pytest.raises(CaseError):
        simulate(Case.from_code("d10h08e10f10"), positions_mm=positions)


def test_a_lump_wider_than_the_gland_is_deep_is_refused():
    with pytest.raises(CaseError, match="does not fit"):
        simulate(Case(30, 0.8, 10))


@pytest.mark.parametrize("change", [{"hx_mm": 0}, {"solver": "magic"}, {"start_mm": 5}, {"tolerance": 1}])
def test_settings_that_make_no_sense_are_refused(change):
    with pytest.raises(CaseError):
        Settings(**change)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, "2", None])
@pytest.mark.parametrize("field", [f.name for f in dataclasses.fields(Settings) if f.name != "solver"])
def test_no_setting_takes_what_is_not_a_finite_number(field, value):
    """left_mm, right_mm and refine took NaN, and right_mm infinity."""
    if field == "far_start_mm" and value is None:
        return
    with pytest.raises(CaseError) as error:
        Settings(**{field: (0.35, value) if field == "skin_mm" else value})
    assert field.split("_mm")[0] in str(error.value) or "mesh sizes" in str(error.value)


def test_a_wide_face_lies_on_fine_columns_to_its_ends():
    """Columns were fine to 14 mm beside the face's middle: 60 mm of flat face sank 8 % too far."""
    case = Case.from_code("d10h08e10f10_Rinf_w30")
    usual, fine = (
        simulate(case, Settings(hx_mm=hx, left_mm=-200, right_mm=200), positions_mm=[-28, -26])
        for hx in (2.0, 1.0)
    )
    np.testing.assert_allclose(usual.displacement_mm, fine.displacement_mm, rtol=0.01)


def test_a_face_too_wide_for_the_sides_is_refused():
    with pytest.raises(CaseError, match="sides"):
        simulate(Case.from_code("d10h08e10f10_Rinf_w40"), positions_mm=[-60, 0])


def test_the_force_balance_is_checked_with_friction_too():
    """It was set to 0 wherever the probe had friction."""
    case = Case.from_code("d10h08e10f10_mu0.3")
    settings = Settings()
    run = StrokeRun(case, settings, geometry_of(case, settings, -28, 0))
    state = run.newton.solve(run.press(-28, None), -28, case.F_N_per_m)
    assert abs(run.read(state, -28)["force_error"]) < 1e-6
    run.case = dataclasses.replace(case, F_rel=1.01)
    with pytest.raises(StrokeError, match="miss the force"):
        run.read(state, -28)


def test_importing_the_package_compiles_nothing():
    code = (
        "import palpate.sim.tissue, sys; sys.exit(any(m in sys.modules for m in ('numba', 'skfem', 'scipy')))"
    )
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def test_frames_beside_the_tissue_s_end_write_nowhere_else(monkeypatch):
    """More than 70 mm behind a lump compiled loops wrote past their arrays: `palpate refine` could crash."""
    for name in ("add_rows", "add_cells", "blend_rows", "blend_cells"):
        monkeypatch.setattr(predictor_kernels, name, getattr(predictor_kernels, name).py_func)  # which checks
    case, settings = Case(11.0, 0.6, 8.0, 0.55), Settings()
    geometry = geometry_of(case, settings, -56.0, 56.0)
    found = solve_frames(case, settings, geometry, np.arange(71.0, 82.0, 2.5), np.full(5, 50.0))
    assert (found.displacement_mm > 0).all()
