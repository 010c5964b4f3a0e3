"""Strokes that the field model is not for and that look as if it were: what its checks are fitted to."""

from __future__ import annotations

import numpy as np

from palpate.features.map_features import Floats
from palpate.regression.any_tissue.observed import scaled
from palpate.regression.checks import Groups
from palpate.regression.field.bench import Bench
from palpate.regression.field.recipe import Recipe
from palpate.regression.observed import NAMES
from palpate.regression.probe_model import shows_lump
from palpate.sim.probe.sensors import Noise, StrokeField
from palpate.sim.probe.two_lumps import APART_MM, random_pair

FEWEST_LUMPS = 200
"""A model of fewer has no checks: they would not tell strange strokes from its own."""

FAT = (1.18, 1.65)
"""How much stiffer or softer another fat is: by a factor between these."""

_FIRST = {"two_lumps": 700, "softer_fat": 800, "stiffer_fat": 850}


def strange_strokes(bench: Bench, noise: Noise | str, recipe: Recipe) -> dict[str, tuple[Floats, Groups]]:
    """Strokes over two lumps, and in a softer or stiffer fat, that show a lump: features and lumps by kind.

    Of training lumps; calibration and test lumps are in none. Moduli and the force times s leave the
    displacement as it is, so another fat needs no simulation.
    """
    train = bench.split.train
    if len(train) < FEWEST_LUMPS:
        return {}
    rng = np.random.default_rng(bench.seed)
    fields = {name: list(bench.lumps) for name in _FIRST}
    for k in train:
        strokes = bench.strokes.lumps[k].strokes
        fields["two_lumps"][k] = random_pair(strokes, APART_MM, rng)
        for name, way in (("softer_fat", -1), ("stiffer_fat", 1)):
            factor = float(np.exp(way * rng.uniform(*np.log(FAT))))
            fields[name][k] = StrokeField(*(scaled(stroke, factor) for stroke in strokes))
    out = {}
    for name, first in _FIRST.items():
        seen = bench.observe(fields[name], train, noise, 1, first, recipe)
        seen = seen.take(seen.whole & shows_lump(seen.X, NAMES))
        out[name] = seen.columns(recipe.features), seen.group
    return out
