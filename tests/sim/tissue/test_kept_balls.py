"""The kept set of balls is what `palpate sweep --design balls:1000:1+balls-soft:96:1 --out DIR
--keep FILE` gives, of the lumps that its recipe names: more teach the emulator little."""

from pathlib import Path

import numpy as np

from palpate.sim.tissue import read_design
from palpate.sim.tissue.settings import SOLID_SOLVER_VERSION
from palpate.sim.tissue.solid.kept import read_kept, read_recipe
from palpate.sim.tissue.solid.stroke import simulate_forces

SET = Path(__file__).parent / "data" / "balls.parquet"


RECIPE, KEPT = read_recipe(SET), read_kept(SET)


def test_the_recipe_names_the_strokes():
    assert RECIPE["solver"] == SOLID_SOLVER_VERSION
    cases = read_design(RECIPE["design"])
    assert [stroke.case for stroke in KEPT] == [
        case for k in RECIPE["lumps"] for case in cases[3 * k : 3 * k + 3]
    ]


def test_two_strokes_computed_again_are_the_kept_ones():
    on_line = (k for k in range(0, len(KEPT), 3) if KEPT[k].case.offset_mm == 0.0)
    quickest = min(on_line, key=lambda k: KEPT[k].case.t_mm)
    kept = KEPT[quickest], KEPT[quickest + 2]
    computed = simulate_forces(kept[0].case, [k.case.F_rel for k in kept], ramp=True)
    for new, old in zip(computed, kept, strict=True):
        assert new.case == old.case
        np.testing.assert_allclose(new.displacement_mm, old.displacement_mm, rtol=1e-4)
        np.testing.assert_allclose(new.images_kPa, old.images_kPa, atol=5e-3)
        np.testing.assert_allclose(new.ramp_images_kPa, old.ramp_images_kPa, atol=5e-3)
