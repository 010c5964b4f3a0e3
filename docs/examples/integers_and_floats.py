"""Compile a model to the integers that the probe runs, and hold them against float64.

    python integers_and_floats.py [SWEEP]

This is the place to start from when you change the compiler, the number formats or the kind of model.
"""

import sys
from array import array
from pathlib import Path

import numpy as np

from firmware_py import evaluator, features, outputs
from palpate.learn.observed import observe
from palpate.learn.thesis.polynomial import fit_thesis_model
from palpate.model_export.exporter import prepare
from palpate.model_export.integers.reference import evaluate
from palpate.sim.probe.sensors import LEVELS, StrokeField
from palpate.sim.tissue import load_strokes, read_design, sweep

SEED = 3
directory = Path(sys.argv[1] if len(sys.argv) > 1 else "out/thesis")

if __name__ == "__main__":  # the sweep's worker processes import this file
    sweep(read_design("thesis"), out_dir=directory)
    strokes = [s for s in load_strokes(directory) if not s.case.nonlinear_lump]
    spec = fit_thesis_model(strokes, seed=SEED)

    # Compiling proves by interval arithmetic that no intermediate leaves +-2^30, whatever the sensors read.
    tables, proof, _ = prepare(spec)
    print(f"{spec.kind} model: {len(spec.features)} features, {len(spec.terms)} terms")
    print(proof)

    observed = observe([StrokeField(s) for s in strokes], LEVELS["typical"].without("force"), SEED)
    observed = observed.take(observed.whole)
    exact = evaluate(spec, observed.features(spec.features))["value"]

    out = array("i", bytes(4 * evaluator.OUT_SIZE))
    integers = np.zeros_like(exact)
    for row, vector in enumerate(observed.X):
        q24 = array("i", [int(v) for v in np.rint(vector * 2**24)])
        assert len(q24) == features.COUNT
        tables.evaluate(q24, out)
        integers[row] = (
            np.array(out[0 : outputs.VALUES : 3]) / 1e6
        )  # value, low, high of each output, in millionths

    difference = np.abs(integers / exact - 1)
    found = integers[:, 0] > 0  # strokes in which the lump rule sees no lump have no numbers
    print(f"{found.sum()} of {len(found)} strokes with a lump found; relative difference to float64:")
    for j, name in enumerate(outputs.NAMES):
        column = difference[found, j]
        print(f"  {name:10} median {np.median(column):.1e}, worst {column.max():.1e}")
