"""A solid lump's case and code say exactly one thing, and a cylinder's mean what they always did."""

import hashlib
import json
from dataclasses import asdict

import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.sim.tissue import Case, CaseError, Settings, case_key, read_design
from palpate.sim.tissue.case import SHAPES
from palpate.sim.tissue.design import settings_of
from palpate.sim.tissue.settings import SOLVER_VERSION


@given(
    d=st.floats(2, 30),
    h=st.floats(0.1, 2),
    axes=st.none() | st.tuples(st.floats(0.5, 20), st.floats(0.5, 14)),
    offset=st.floats(-20, 20),
    fat=st.none() | st.floats(2, 60),
    radius=st.floats(20, 400),
)
def test_every_solid_case_has_a_code_that_reads_back_as_exactly_that_case(d, h, axes, offset, fat, radius):
    shape = {"shape": "ball"} if axes is None else {"shape": "ellipsoid"}
    if axes is not None:
        shape |= {"half_across_mm": axes[0], "half_down_mm": axes[1]}
    rest = {"offset_mm": offset, "fat_mm": fat, "across_radius_mm": radius, "gland_mm": 100.0}
    case = Case(d, h, 10, 0.7, **shape, **rest)
    again = Case.from_code(case.code)
    assert again == case
    assert case_key(again, Settings()) == case_key(case, Settings())


def test_an_ellipsoid_lies_where_its_code_says():
    case = Case.from_code("d10h08e10f10_ellipsoid8x4_y-3_t15")
    assert (case.shape, case.half_axes_mm, case.offset_mm) == ("ellipsoid", (5, 8, 4), -3)
    assert (case.depth_mm, case.centre_mm, case.t_mm) == (8, 12, 15)
    assert pytest.approx(3.9) == case.F_N
    assert Case.from_code("d10h08e10f10_ellipsoid8x4").t_mm == 12
    assert Case.from_code("d10h08e10f10_ball").t_mm == 13


def test_a_cylinder_keeps_its_key():
    """What came with the balls, and new settings, are not in it: what was computed before is found again."""
    case = Case.from_code("d12h07e20f09_R60")
    old = {name: value for name, value in asdict(case).items() if name in ORIGINAL}
    settings = {name: value for name, value in asdict(Settings()).items() if name in NUMERICS}
    record = {"case": old, "settings": settings, "solver": SOLVER_VERSION}
    text = json.dumps(record, sort_keys=True, separators=(",", ":"))
    assert case_key(case, Settings()) == hashlib.sha256(text.encode()).hexdigest()[:32]


ORIGINAL = {
    "d_mm", "h", "E_ratio", "F_rel", "lump_stiffening", "fat_stiffening", "gland_stiffening", "fat_kPa",
    "gland_ratio", "poisson", "gland_mm", "probe_radius_mm", "face_half_mm", "fillet_per_mm2", "friction",
}  # fmt: skip
NUMERICS = {
    "hx_mm", "increment_mm", "start_mm", "far_start_mm", "refine", "row_mm", "gland_row_mm", "skin_mm",
    "left_mm", "right_mm", "tolerance", "solver",
}  # fmt: skip


@pytest.mark.parametrize(
    "options",
    ["ball5", "ball_ball", "ball_ellipsoid8x4", "ellipsoid8", "ellipsoid8x4x2", "ellipsoid8x", "ellipsoid",
     "y5", "t0.2", "ball_y--5", "ball_yinf", "ball_t0", "ball_mu0.2", "ball_g1", "ball_R-40", "Ra100",
     "ball_y5_y5", "ball_y\u0665", "ellipsoid\u0668x4", "Ball", "ball_", "cylinder"],
)  # fmt: skip
def test_a_wrong_option_is_refused_in_one_sentence(options):
    with pytest.raises(CaseError) as error:
        Case.from_code("d10h08e10f10_" + options)
    assert "\n" not in str(error.value)


def test_the_design_of_balls_is_seeded_and_covers_what_it_says():
    cases = read_design("balls:64:3")
    assert len(cases) == 192
    assert cases == read_design("balls:64:3") == read_design("balls:100:3")[:192]
    assert cases != read_design("balls:64:4")
    assert len(read_design("balls")) == 3000
    assert [Case.from_code(case.code) for case in cases] == cases
    low, high = cases[::3], cases[2::3]
    assert all(b.F_rel == pytest.approx(1.4 * a.F_rel, rel=1e-3) for a, b in zip(low, high))
    assert 0.3 < sum(case.shape == "ball" for case in low) / 64 < 0.7
    assert 0.6 < sum(case.offset_mm == 0 for case in low) / 64 < 0.9
    assert min(case.gland_ratio for case in low) < 2.5
    assert max(case.gland_ratio for case in low) > 9


def test_designs_joined_by_a_plus_are_run_one_after_the_other():
    """So the kept set has tissue of nearly one material, too, without the other lumps drawn anew."""
    soft = read_design("balls-soft:32:1")
    assert read_design("balls:64:3+balls-soft:32:1") == read_design("balls:64:3") + soft
    assert 1.0 <= min(case.gland_ratio for case in soft) < 1.1
    assert 1.8 < max(case.gland_ratio for case in soft) <= 2.0
    with pytest.raises(CaseError, match="'stones:3' is not a design"):
        read_design("balls:64:3+stones:3")
    with pytest.raises(CaseError, match="swept apart"):
        settings_of("any:4+balls:4", 2.0)


def test_small_lumps_that_lie_deep_are_a_design_of_their_own():
    """A ball of 5 mm, 10 mm deep, was told as one of 16: the emulator had not met such lumps."""
    lumps = read_design("balls-deep:64:1")[::3]
    assert sum(case.d_mm < 6 and case.h > 1.5 for case in lumps) > 4
    assert sum(case.gland_ratio < 1.5 for case in lumps) > 8
    assert max(case.d_mm for case in lumps) <= 12


def test_another_body_is_one_row_of_the_table_of_shapes(monkeypatch):
    """Its name was asked for in three places of the code's reader and writer."""
    monkeypatch.setitem(SHAPES, "disc", (1.0, 0.5))
    disc = Case.from_code("d10h08e10f10_disc_y5")
    assert disc.solid and disc.half_axes_mm == (5.0, 5.0, 2.5) and disc.t_mm == 10.5
    assert Case.from_code(disc.code) == disc and disc.code.endswith("_disc_y5")
    with pytest.raises(CaseError, match="known are ball, disc, ellipsoidAxB"):
        Case.from_code("d10h08e10f10_bean")
