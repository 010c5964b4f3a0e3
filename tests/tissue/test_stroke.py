"""A stroke gives what the thesis measures, and says so when it cannot."""

import json
import subprocess
import sys

import numpy as np
import pytest

from sim.tissue import Case, CaseError, Settings, Stroke, StrokeError, simulate, simulate_forces


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


def test_a_probe_pressed_through_the_tissue_is_an_error_that_names_place_and_reason():
    with pytest.raises(StrokeError, match=r"failed at -28\.0 mm: pressing") as error:
        simulate(Case(10, 0.8, 10, F_rel=100))
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


def test_importing_the_package_compiles_nothing():
    code = "import sim.tissue, sys; sys.exit(any(m in sys.modules for m in ('numba', 'skfem', 'scipy')))"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0
