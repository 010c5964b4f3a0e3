"""The kept set of balls is what `palpate sweep --design balls:32:1 --out DIR --keep FILE` gives."""

from pathlib import Path

import numpy as np

from palpate.sim.tissue import read_design
from palpate.sim.tissue.settings import SOLID_SOLVER_VERSION
from palpate.sim.tissue.solid.kept import read_kept, read_recipe
from palpate.sim.tissue.solid.stroke import simulate_forces

SET = Path(__file__).parent / "data" / "balls.parquet"


def test_the_recipe_names_the_strokes():
    recipe, kept = read_recipe(SET), read_kept(SET)
    assert recipe["solver"] == SOLID_SOLVER_VERSION
    assert [stroke.case for stroke in kept] == read_design(recipe["design"])


def test_two_strokes_computed_again_are_the_kept_ones():
    kept = read_kept(SET)
    on_line = [stroke for stroke in kept if stroke.case.offset_mm == 0.0]
    small = min(on_line, key=lambda stroke: stroke.case.t_mm)
    weak, _, strong = (stroke for stroke in kept if stroke.case.d_mm == small.case.d_mm)
    again = simulate_forces(small.case, [weak.case.F_rel, strong.case.F_rel], ramp=True)
    for new, old in zip(again, (weak, strong), strict=True):
        assert new.case == old.case
        np.testing.assert_allclose(new.displacement_mm, old.displacement_mm, rtol=1e-4)
        np.testing.assert_allclose(new.images_kPa, old.images_kPa, atol=5e-3)
        np.testing.assert_allclose(new.ramp_images_kPa, old.ramp_images_kPa, atol=5e-3)
