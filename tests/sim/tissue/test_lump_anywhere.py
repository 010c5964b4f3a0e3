"""The border between fat and gland need not pass through the lump: the fat has a thickness of its own."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.features.map_features import stroke_features
from palpate.sim.tissue import Case, CaseError, Settings, case_key, load_strokes, read_design, simulate, sweep
from palpate.sim.tissue.any_tissue import PRESS_PARTS, TissueRanges
from palpate.sim.tissue.anywhere import (
    PlaceRanges,
    anywhere_cases,
    anywhere_lumps,
    anywhere_plain,
    anywhere_rim,
)
from palpate.sim.tissue.design import settings_of
from palpate.sim.tissue.element import integrate
from palpate.sim.tissue.mesh import FAT, GLAND, LUMP, build_mesh

PLACES_MM = {"in the fat": 25.0, "touching the gland": 16.0, "cut above": 13.5, "cut below": 8.5,
             "touching the fat": 6.0, "in the gland": 3.0}  # fmt: skip
"""Of the border under the skin, about a lump between 6 and 16 mm."""


def lump(fat_mm, **options):
    return replace(Case(10.0, 0.6, 10.0, 0.6, fat_mm=fat_mm, gland_mm=20.0), **options)


@given(d=st.floats(0.5, 30), h=st.floats(0.02, 3), fat=st.none() | st.floats(0.3, 60))
def test_every_case_with_fat_of_its_own_has_a_code_that_reads_back_as_exactly_that_case(d, h, fat):
    case = Case(d, h, 10.0, fat_mm=fat, gland_mm=200.0)
    again = Case.from_code(case.code)
    assert again == case
    assert case_key(again, Settings()) == case_key(case, Settings())
    assert case.t_mm + case.border_mm == pytest.approx(case.depth_mm + d / 2)


def test_the_code_says_how_deep_lump_and_border_lie():
    case = Case.from_code("d10h08e10f10_t18")
    assert (case.depth_mm, case.t_mm, case.border_mm) == (8, 18, -5)
    assert case_key(case, Settings()) != case_key(replace(case, fat_mm=None), Settings())


@pytest.mark.parametrize("code", ["d10h08e10f10_t0.2", "d10h08e10f10_t2_g15", "d10h08e10f10_t201"])
def test_a_lump_that_does_not_fit_over_the_chest_wall_is_refused(code):
    with pytest.raises(CaseError):
        Case.from_code(code)


@pytest.mark.parametrize("times_finer", [1, 2])
@pytest.mark.parametrize("share", [-2.5, -1.3, -1.0, -0.99, -0.7, -0.3, 0.0, 0.3, 0.7, 0.99, 1.0, 1.2])
def test_the_mesh_follows_the_border_wherever_it_passes(share, times_finer):
    case = lump(11 - 5 * share)
    mesh = build_mesh(case, Settings().refined(times_finer), -28.0, 0.0)
    dx = integrate(mesh).dx
    assert dx.min() > 0
    area = {m: dx[mesh.material == m].sum() for m in (FAT, GLAND, LUMP)}
    angle = 2 * np.arccos(np.clip(share, -1, 1))
    cap = 12.5 * (angle - np.sin(angle))  # of the lump, in the fat
    assert area[LUMP] == pytest.approx(25 * np.pi, rel=1e-3)
    width = np.ptp(mesh.nodes_mm[:, 0])
    # Where it grazes the lump the border bends: by a hundredth of the radius, over half the box.
    graze = 0.4 if abs(abs(share) - 1) < 0.02 else 2e-3
    assert area[FAT] == pytest.approx(width * case.t_mm - cap, abs=graze)
    assert area[GLAND] == pytest.approx(width * 20 - (25 * np.pi - cap), abs=graze)


def test_the_tied_thickness_given_as_ones_own_is_the_tied_stroke():
    tied = simulate(lump(None))
    own = simulate(lump(11.0))
    np.testing.assert_allclose(own.images_kPa, tied.images_kPa, atol=1e-4)
    np.testing.assert_allclose(own.displacement_mm, tied.displacement_mm, atol=1e-6)


def test_a_gland_like_fat_makes_the_border_irrelevant():
    first, *others = (
        stroke_features(simulate(lump(fat, gland_mm=36 - fat, gland_ratio=1.0))) for fat in PLACES_MM.values()
    )
    for other in others:
        assert other.D28_mm == pytest.approx(first.D28_mm, rel=0.003)
        assert other.base_kPa == pytest.approx(first.base_kPa, rel=0.005)
        assert other.amp_kPa == pytest.approx(first.amp_kPa, rel=0.05)


@pytest.mark.parametrize("fat", PLACES_MM.values(), ids=PLACES_MM)
def test_a_mesh_twice_as_fine_says_the_same(fat):
    coarse, fine = (stroke_features(simulate(lump(fat), Settings().refined(k))) for k in (1, 2))
    assert coarse.D28_mm == pytest.approx(fine.D28_mm, rel=0.003)
    assert coarse.base_kPa == pytest.approx(fine.base_kPa, rel=0.005)
    assert coarse.amp_kPa == pytest.approx(fine.amp_kPa, abs=0.002 * fine.base_kPa + 0.02 * fine.amp_kPa)


@pytest.mark.parametrize("touching", [6.0, 16.0])
def test_a_border_that_begins_to_cut_the_lump_changes_little(touching):
    """.1 mm on either side of touching: less than what .4 mm of tissue make."""

    def image(fat):
        return simulate(lump(fat), positions_mm=[-4.0, 0.0]).images_kPa

    step = np.abs(image(touching - 0.1) - image(touching + 0.1)).max()
    usual = np.abs(image(touching + 0.4) - image(touching + 0.8)).max()
    assert step < usual


def test_without_a_lump_its_place_means_nothing():
    own = simulate(lump(13.0, E_ratio=1.0))
    plain = simulate(Case.without_lump(13.0, 0.6, gland_mm=20.0))
    assert own.displacement_mm == pytest.approx(plain.displacement_mm, rel=1e-9)
    deep = simulate(Case.from_code("d20h15e01f06_t3_g8"))
    assert deep.strain.max() < 1


def test_a_sweep_keeps_the_thickness(tmp_path):
    cases = [lump(None), lump(25.0)]
    sweep(cases, Settings(press_only=True, start_mm=-40.0), tmp_path, workers=1)
    assert [stroke.case for stroke in load_strokes(tmp_path)] == cases


def test_the_design_puts_lumps_everywhere_and_a_longer_one_begins_with_the_shorter():
    cases = read_design("anywhere:64:3")
    assert len(cases) == 192 and cases == anywhere_cases(100, 3)[:192] != read_design("anywhere:64:4")
    assert [case.d_mm for case in read_design("anywhere-press:64:3")[:: len(PRESS_PARTS)]] == [
        c.d_mm for c in cases[::3]
    ]
    off = np.array([2 * case.border_mm / case.d_mm for case in cases[::3]])
    assert min(np.mean(off < -1), np.mean(np.abs(off) < 1), np.mean(off > 1)) > 0.15
    assert all(5 <= c.d_mm <= 20 and 1.99 < c.depth_mm < 30.1 and 4 <= c.t_mm <= 30 for c in cases)
    assert list(settings_of("anywhere-press:3", 2.0).positions_mm()) == [-40.0]
    assert settings_of("anywhere:3", 2.0).positions_mm()[0] == -44.0


@pytest.mark.parametrize("case", anywhere_cases(5, 7)[2::3], ids=lambda case: case.code)
def test_random_lumps_are_stroked(case):
    _check(simulate(case))


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_a_hundred_random_lumps_at_their_largest_force_none_fails(tmp_path):
    table = sweep(anywhere_cases(100, 11)[2::3], settings_of("anywhere:100", 2.0), tmp_path)
    assert list(table.code[table.status != "ok"]) == []
    for stroke in load_strokes(tmp_path):
        _check(stroke)


def _check(stroke):
    assert np.abs(stroke.force_error).max() < 1e-6, stroke.code
    assert (stroke.images_kPa >= 0).all(), stroke.code
    assert (stroke.smallest_jacobian > 0).all(), stroke.code
    assert (np.abs(np.diff(stroke.displacement_mm)) < 1.5).all(), stroke.code


def test_the_rim_lies_outside_the_ranges_and_plain_tissue_has_no_lump():
    ranges, place = TissueRanges(), PlaceRanges()
    for case in anywhere_rim(40, 3):
        inside = [
            low <= value <= high
            for value, (low, high) in (
                (case.d_mm, ranges.d_mm),
                (case.E_ratio, ranges.E_ratio),
                (case.t_mm, place.fat_mm),
            )
        ]
        assert not all(inside)
        assert place.depth_mm[0] * 0.99 <= case.depth_mm <= place.depth_mm[1] * 1.01, "but no deeper"
    plain, lumps = anywhere_plain(8, 3), anywhere_lumps(8, 3)
    assert not any(case.has_lump for case in plain)
    assert [case.t_mm for case in plain] == [case.t_mm for case in lumps]
