"""How much sensor noise costs: the same lumps, felt with better and worse sensors, by the same model.

    python noise_and_error.py [SWEEP]

A model of the thesis kind is trained for typical sensors; lumps that it has never seen are then stroked with
four qualities of sensor. The hand's force is steady here: to let it wander, simulate more (docs/models.md).
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd

from palpate.learn.observed import observe
from palpate.learn.thesis.polynomial import fit_thesis_model
from palpate.model_export.integers.reference import evaluate
from palpate.sim.probe.sensors import LEVELS, StrokeField
from palpate.sim.tissue import load_strokes, read_design, sweep
from palpate.sim.tissue.design import Ranges, sobol_cases

SEED = 7
OUTPUTS = ("F_N_per_m", "t_mm", "d_mm", "h", "E_inv23")

directory = Path(sys.argv[1] if len(sys.argv) > 1 else "out/thesis")

if __name__ == "__main__":  # the sweep's worker processes import this file
    sweep(read_design("thesis"), out_dir=directory)
    spec = fit_thesis_model(load_strokes(directory), seed=SEED, noise="typical")

    unseen = sobol_cases(16, SEED, Ranges(d_mm=(8, 18), h=(0.4, 1.2), E_ratio=(5, 1000), F_rel=(0.5, 1.0)))
    sweep(unseen, out_dir=directory.parent / "unseen")
    lumps = [StrokeField(stroke) for stroke in load_strokes(directory.parent / "unseen")]

    rows = []
    for name in ("none", "good", "typical", "poor"):
        strokes = observe(lumps, LEVELS[name].at_one_force(), SEED)
        strokes = strokes.take(strokes.whole)
        said = evaluate(spec, strokes.features(spec.features))
        said = {part: said[part][:, : len(OUTPUTS)] for part in ("value", "low", "high")}
        true = strokes.values[:, : len(OUTPUTS)]
        error = np.abs(said["value"] / true - 1)
        inside = (said["low"] <= true) & (said["high"] >= true)
        rows.append(
            {"noise": name, "strokes": len(strokes)}
            | {f"{output} %": 100 * np.median(error[:, j]) for j, output in enumerate(OUTPUTS[:4])}
            | {"E_inv23": np.median(np.abs(said["value"] - true)[:, 4])}
            | {"in the interval %": 100 * inside.mean()}
        )
    print("median error of each output (E_inv23: not relative), how often the 90 % intervals hold the truth")
    print(pd.DataFrame(rows).set_index("noise").round(2).to_string())
