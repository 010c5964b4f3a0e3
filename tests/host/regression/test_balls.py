"""Balls and ellipsoids as the probe sees them: place and width across the stroke, a press for nothing."""

from pathlib import Path

import numpy as np
import pytest

from palpate.errors import UsageError
from palpate.regression.balls import lumps, observed, study
from palpate.regression.balls.across import across
from palpate.sim.probe.cells import COLUMN_MM
from palpate.sim.tissue.solid.kept import read_kept

SET = Path(__file__).parents[2] / "sim" / "tissue" / "data"


@pytest.fixture(scope="module")
def kept():
    """The lumps of the kept set."""
    return lumps.prepare(SET, 1)


@pytest.mark.parametrize(("place", "width"), [(0.0, 4.0), (6.0, 3.0), (-9.0, 5.0)])
def test_a_bump_across_is_found_where_it_is_and_as_wide_as_it_is(place, width):
    rng = np.random.default_rng(1)
    bump = np.exp(-((COLUMN_MM - place) ** 2) / (2 * width**2))
    seen = across(40 + 400 * bump + 8 * rng.standard_normal(26))
    assert seen.place_mm == pytest.approx(place, abs=0.4)
    assert seen.width_mm == pytest.approx(width, rel=0.15)
    assert across(40 + 400 * bump[::-1]).place_mm == pytest.approx(
        -across(40 + 400 * bump).place_mm, abs=1e-6
    )


def test_columns_that_all_see_as_much_say_so():
    rng = np.random.default_rng(2)
    assert across(400 + 2 * rng.standard_normal(26)).share > 0.9
    assert across(400 * np.exp(-(COLUMN_MM**2) / 18)).share < 0.4


def test_every_lump_of_the_set_has_three_forces_and_a_press_below_them(kept):
    assert 3 * len(kept) == len(read_kept(SET / "balls.parquet"))
    for lump in kept:
        forces = [stroke.F_N_per_m for stroke in lump.press]
        assert len(lump.press) == 5 and forces == sorted(forces)
        assert forces[2:] == [stroke.F_N_per_m for stroke in lump.strokes.strokes]
        depths = [float(stroke.displacement_mm[0]) for stroke in lump.press]
        assert depths == sorted(depths)
        for stroke in lump.press:
            mean_kPa = float(stroke.images_kPa.mean())
            assert mean_kPa == pytest.approx(stroke.F_N_per_m / (16 * 1.5), rel=0.1)


def test_a_lump_beside_the_line_is_seen_on_its_side(kept):
    clear = [k for k in kept if k.case.offset_mm > 3 and k.case.depth_mm < 10]
    assert clear
    seen = observed.observe(clear, "none", 1, None)
    assert (seen.place_mm > 1.0).all()
    turned = [
        lumps.SolidLump(
            type(k.strokes)(tuple(lumps.beside(s) for s in k.strokes.strokes)),
            tuple(lumps.beside(s) for s in k.press),
        )
        for k in clear
    ]
    other = observed.observe(turned, "none", 1, None)
    assert other.place_mm == pytest.approx(-seen.place_mm, abs=0.1)
    np.testing.assert_allclose(other.Y, seen.Y)


def test_the_plane_strain_model_is_worse_over_balls_than_one_that_has_met_some(kept):
    result = study.table_of(kept, ("typical",), draws=3).set_index("setting")
    ours, plane = result.loc["typical, with its press"], result.loc["typical, plane-strain model"]
    assert ours.d_error < 0.5 * plane.d_error and ours.t_error < 0.5 * plane.t_error
    assert ours.reach_error < 0.15
    assert plane.flagged > 0.5  # and says so itself
    heads, rows = study.text_of(result.reset_index())
    assert all(len(row) == len(heads) for row in rows) and len(rows) == 4


def test_a_set_without_whole_lumps_is_refused():
    alone = read_kept(SET / "balls.parquet")[:2]
    with pytest.raises(UsageError, match="three forces"):
        lumps.solid_lumps(alone)
