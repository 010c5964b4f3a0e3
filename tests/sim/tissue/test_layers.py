"""Tissue is a list of layers: a muscle under the gland is one more, in the plane and round solid lumps."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.sim.tissue import Case, CaseError, Settings, load_strokes, simulate, sweep
from palpate.sim.tissue.fields import simulate_fields
from palpate.sim.tissue.layers import MATERIALS
from palpate.sim.tissue.topology import OutsideTopology, Topology

PLACES_MM = [-28.0, -5.0, 0.0]
QUICK = Settings(hx_mm=4.0)
EXACT = Settings(tolerance=1e-7)


def felt(code, settings=None, places_mm=PLACES_MM):
    stroke = simulate(Case.from_code(code), settings, places_mm)
    return np.concatenate([stroke.displacement_mm, stroke.images_kPa.ravel()])


@given(
    mm=st.floats(1, 200),
    ratio=st.floats(0.1, 1000),
    b=st.floats(0, 2000),
    law=st.sampled_from(["exponential", "ogden"]),
)
def test_a_case_with_muscle_has_a_code_that_reads_back_as_exactly_that_case(mm, ratio, b, law):
    case = Case(10.0, 0.8, 10.0, muscle_mm=mm, muscle_ratio=ratio, muscle_stiffening=b, law=law)
    assert Case.from_code(case.code) == case == Case(**case.to_dict())


def test_layers_lie_from_the_skin_down_to_the_chest_wall():
    case = Case.from_code("d10h08e10f10_m10_M20_sm3")
    assert [(layer.name, layer.mm, layer.ratio, layer.stiffening) for layer in case.layers] == [
        ("fat", 13.0, 1.0, 0.0),
        ("gland", 15.0, 6.0, 0.0),
        ("muscle", 10.0, 20.0, 3.0),
    ]
    assert case.borders_mm == (0.0, -15.0, -25.0)
    assert [layer.name for layer in Case.from_code("d10h08e10f10").layers] == ["fat", "gland"]


def test_a_case_without_muscle_says_nothing_of_it():
    """So that keys, codes and records are those of when there was none."""
    assert not [name for name in Case.from_code("d10h08e10f10").to_dict() if "muscle" in name]


@pytest.mark.parametrize(
    ("code", "sentence"),
    [
        ("d10h08e10f10_M20", "a case without muscle_mm has no muscle"),
        ("d10h08e10f10_m0.5", "muscle_mm must lie between 1 and 200"),
        ("d20h08e10f10_m10_g8", "does not fit into 8 mm over the muscle"),
        ("d10h08e10f10_t2_g12_m10", "does not fit over a muscle at 14 mm"),
        ("d10h08e10f10_ball_g4_m10", "does not fit over a muscle"),
    ],
)
def test_a_muscle_that_makes_no_sense_is_refused_in_one_sentence(code, sentence):
    with pytest.raises(CaseError, match=sentence):
        simulate(Case.from_code(code), QUICK)


@pytest.mark.parametrize(
    ("muscle", "gland"),
    [
        ("d10h08e10f10_m10", "d10h08e10f10_g25"),
        ("d10h08e10f10_sf2_sg4_m10_sm4", "d10h08e10f10_sf2_sg4_g25"),
        ("d10h08e10f10_t25_m10", "d10h08e10f10_t25_g25"),
        ("d10h08e10f10_t2_g25_m10", "d10h08e10f10_t2_g35"),
        ("d10h08e01f10_t25_m10", "d10h08e01f10_t25_g25"),
    ],
)
def test_a_muscle_as_stiff_as_the_gland_is_a_thicker_gland(muscle, gland):
    np.testing.assert_allclose(felt(muscle, EXACT), felt(gland, EXACT), rtol=1e-5, atol=1e-6)


def test_a_very_stiff_muscle_is_a_chest_wall():
    np.testing.assert_allclose(felt("d10h08e10f10_m10_M1000"), felt("d10h08e10f10"), rtol=2e-3, atol=1e-3)


def test_a_muscle_as_soft_as_fat_gives_way():
    soft, wall = felt("d10h08e10f10_m10_M1"), felt("d10h08e10f10")
    assert (soft[:3] > 1.1 * wall[:3]).all()


def test_a_ball_over_muscle_is_the_ball_over_a_thicker_gland():
    over_muscle, over_gland = (felt(f"d10h08e10f07_{deep}_ball", QUICK, [0.0]) for deep in ("m10", "g25"))
    np.testing.assert_allclose(over_muscle, over_gland, rtol=1e-4, atol=1e-5)


def test_fields_name_the_muscle():
    _, (fields,) = simulate_fields(Case.from_code("d10h08e10f10_m10"), None, [0.0])
    deep = fields.points_mm[fields.cells, 1].mean(1) < -15
    assert (fields.material[deep] == MATERIALS.index("muscle")).all()
    assert set(fields.material[~deep]) == {0, 1, 2}


@pytest.mark.parametrize("more", ["_m10_M20", "_p0.01", "_sf4_ogden"])
def test_a_sweep_keeps_what_other_cases_do_not_say(tmp_path, more):
    """A table whose cases had no padding could not be read when padding came."""
    cases = [Case.from_code("d10h08e10f10" + option) for option in (more, "")]
    sweep(cases, replace(QUICK, start_mm=0.0), tmp_path, workers=1)
    assert [stroke.case for stroke in load_strokes(tmp_path)] == cases


def test_one_topology_serves_one_list_of_layers():
    topology = Topology(Case.from_code("d10h08e10f10"), QUICK, -5.0, 5.0)
    with pytest.raises(OutsideTopology, match="layers"):
        topology.geometry(Case.from_code("d10h08e10f10_m10"))
