"""Presses on tissues that are off: what a told model is to notice."""

import math

import pytest

from palpate.learn import design
from palpate.sim.tissue.any_tissue import REFERENCE_PARTS


def test_a_told_model_has_presses_on_other_tissues_at_rising_forces(strokes):
    for other in strokes.others:
        middle = other.strokes.strokes[1].F_N_per_m
        forces = [press.F_N_per_m / middle for press in other.strokes.press]
        assert forces == pytest.approx(REFERENCE_PARTS)
    assert {other.kind for other in strokes.others} == {"probe_radius_mm", "fat_stiffening"}


def test_other_tissues_are_off_in_one_thing_by_what_the_check_is_told():
    usual = {"gland_ratio": 8.0, "probe_radius_mm": 50.0}
    cases = design.other_cases(8, 41, usual)
    assert len(cases) == 8
    assert all(case.gland_ratio == 8.0 and not case.has_lump for case in cases)
    off = [(math.log(c.probe_radius_mm / 50.0), c.fat_stiffening) for c in cases]
    low, high = map(math.log, design.RADIUS)
    for radius, b in off:
        assert (radius == 0) != (b == 0)
        assert radius == 0 or (low <= abs(radius) + 1e-4 and abs(radius) <= high + 1e-4)
        assert b == 0 or design.STIFFENING[0] <= b <= design.STIFFENING[1]
    assert min(off)[0] < 0 < max(off)[0], "faces larger and smaller"
