"""A told model gets the presses that its directory lacks, and presses on tissues that are off."""

import math

import pytest

from palpate.learn import data, design
from palpate.learn.design import PRESS_PARTS
from palpate.sim.tissue.any_tissue import REFERENCE_PARTS


@pytest.fixture(scope="module")
def directory(tmp_path_factory):
    """As older releases made it: no design."""
    home = tmp_path_factory.mktemp("told")
    data.prepare(home, 4, rim=2, plain=0, wide=0, workers=1)
    assert not list(home.glob("*-press")), "too few lumps for checks need none"
    return home


def test_a_directory_of_before_gets_the_presses_that_it_lacks(directory, monkeypatch):
    monkeypatch.setattr(data, "FEWEST_LUMPS", 2)
    old = data.read(directory)
    assert not any(lump.press for lump in old.lumps)
    strokes = data.prepare(directory, 4, rim=2, plain=0, wide=0, workers=1)
    for lump in (*strokes.lumps, *strokes.rim):
        middle = lump.strokes[1].F_N_per_m
        assert [p.F_N_per_m / middle for p in lump.press] == pytest.approx(PRESS_PARTS)
    written = {path: path.stat().st_mtime_ns for path in directory.glob("*/strokes.parquet")}
    assert {path.parent.name for path in written} == {
        "lumps",
        "rim",
        "lumps-press",
        "rim-press",
        "other-press",
    }
    again = data.prepare(directory, 4, rim=2, plain=0, wide=0, workers=1)
    assert written == {path: path.stat().st_mtime_ns for path in written}
    assert [lump.press[0].case for lump in again.lumps] == [lump.press[0].case for lump in strokes.lumps]


def test_other_tissues_are_off_in_one_thing_by_what_the_check_is_told():
    usual = {"gland_ratio": 8.0, "probe_radius_mm": 50.0}
    cases = design.other_cases(8, usual)
    assert len(cases) == 8 * len(REFERENCE_PARTS)
    assert all(case.gland_ratio == 8.0 and not case.has_lump for case in cases)
    off = [(math.log(c.probe_radius_mm / 50.0), c.fat_stiffening) for c in cases[:: len(REFERENCE_PARTS)]]
    low, high = map(math.log, design.RADIUS)
    for radius, b in off:
        assert (radius == 0) != (b == 0)
        assert radius == 0 or (low <= abs(radius) + 1e-4 and abs(radius) <= high + 1e-4)
        assert b == 0 or design.STIFFENING[0] <= b <= design.STIFFENING[1]
    assert min(off)[0] < 0 < max(off)[0], "faces larger and smaller"
