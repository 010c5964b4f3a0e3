"""Kept sets of balls are what `palpate sweep --design balls:1000:1+balls-soft:96:1 --out DIR --keep FILE`
gives, of the lumps that its recipe names (more teach the emulator little), and `--design balls-deep:80:1`."""

import json
from pathlib import Path

import numpy as np
import pytest

from palpate.models import emulator_path
from palpate.sim.tissue import read_design
from palpate.sim.tissue.settings import SOLID_SOLVER_VERSION
from palpate.sim.tissue.solid.kept import read_kept, read_recipe
from palpate.sim.tissue.solid.stroke import simulate_forces

DATA = Path(__file__).parent / "data"
SETS = [DATA / "balls.parquet", DATA / "balls-deep.parquet"]


@pytest.mark.parametrize("path", SETS, ids=lambda path: path.stem)
def test_the_recipe_names_the_strokes(path):
    recipe = read_recipe(path)
    assert recipe["solver"] == SOLID_SOLVER_VERSION
    cases = read_design(recipe["design"])
    lumps = recipe.get("lumps", range(len(cases) // 3))
    assert [stroke.case for stroke in read_kept(path)] == [
        case for k in lumps for case in cases[3 * k : 3 * k + 3]
    ]


def test_the_emulator_has_learnt_from_these_sets():
    learnt = json.loads(emulator_path().with_suffix(".recipe.json").read_text())["sets"]
    assert learnt == [{"set": path.name, "sha256": read_recipe(path)["sha256"]} for path in SETS]


@pytest.mark.parametrize("path", [SETS[0], pytest.param(SETS[1], marks=pytest.mark.long)])
def test_two_strokes_computed_again_are_the_kept_ones(path):
    every = read_kept(path)
    on_line = (k for k in range(0, len(every), 3) if every[k].case.offset_mm == 0.0)
    quickest = min(on_line, key=lambda k: every[k].case.t_mm)
    kept = every[quickest], every[quickest + 2]
    computed = simulate_forces(kept[0].case, [k.case.F_rel for k in kept], ramp=True)
    for new, old in zip(computed, kept, strict=True):
        assert new.case == old.case
        np.testing.assert_allclose(new.displacement_mm, old.displacement_mm, rtol=1e-4)
        np.testing.assert_allclose(new.images_kPa, old.images_kPa, atol=5e-3)
        np.testing.assert_allclose(new.ramp_images_kPa, old.ramp_images_kPa, atol=5e-3)
