"""The kept set of balls is what `palpate sweep --design balls:1000:1+balls-soft:96:1 --out DIR
--keep FILE` gives, or near to it: `tests.studies.carried` has carried lumps over from an earlier mesh."""

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
    assert [stroke.case for stroke in KEPT] == read_design(RECIPE["design"])


def again(lump):
    """The smallest and the greatest force over a lump, computed and as they are kept."""
    kept = KEPT[3 * lump], KEPT[3 * lump + 2]
    return zip(simulate_forces(kept[0].case, [k.case.F_rel for k in kept], ramp=True), kept, strict=True)


def smallest(lumps):
    """The one on the line that takes least time."""
    return min((k for k in lumps if KEPT[3 * k].case.offset_mm == 0.0), key=lambda k: KEPT[3 * k].case.t_mm)


def test_two_strokes_computed_again_are_the_kept_ones():
    for new, old in again(smallest(RECIPE["computed"])):
        assert new.case == old.case
        np.testing.assert_allclose(new.displacement_mm, old.displacement_mm, rtol=1e-4)
        np.testing.assert_allclose(new.images_kPa, old.images_kPa, atol=5e-3)
        np.testing.assert_allclose(new.ramp_images_kPa, old.ramp_images_kPa, atol=5e-3)


def test_strokes_carried_over_from_an_earlier_mesh_are_as_near_as_the_recipe_says():
    """Their outermost columns read a fifth too low once."""
    told = RECIPE["carried"]
    assert told["displacement_after"] < 5e-4
    for new, old in again(smallest(set(range(len(KEPT) // 3)) - set(RECIPE["computed"]))):
        np.testing.assert_allclose(new.displacement_mm, old.displacement_mm, rtol=3e-3)
        off = (old.images_kPa - new.images_kPa) / new.images_kPa.mean((1, 2), keepdims=True)
        assert np.sqrt((off[:, :, [0, -1]] ** 2).mean()) < 3 * told["edge_after"] < 0.15
        assert np.sqrt((off[:, :, 1:-1] ** 2).mean()) < 3 * told["rest_after"] < 0.05
