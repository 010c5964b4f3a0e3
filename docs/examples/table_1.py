"""Table 1 of the thesis from its thirty strokes, and one equation looked at closely.

    python table_1.py [SWEEP]

The strokes are simulated into the directory SWEEP, or read from it where they are already.
"""

import sys
from pathlib import Path

from rich.console import Console

from palpate.learn.thesis.fit import fit_thesis
from palpate.learn.thesis.runs import features_table, thesis_strokes
from palpate.sim.tissue import load_strokes, read_design, sweep

directory = Path(sys.argv[1] if len(sys.argv) > 1 else "out/thesis")

if __name__ == "__main__":  # the sweep's worker processes import this file
    sweep(read_design("thesis"), out_dir=directory)
    table = features_table(thesis_strokes(load_strokes(directory)))
    fit = fit_thesis(table, permutations=0)
    Console(width=150).print(fit.tables()[0])

    # The diameter of hard lumps from pressure and displacement: which terms, how sure, which run pulls most?
    entry = fit.entry("d", "hard", displacement=True)
    equation = entry.direct
    print(equation.text())
    print(equation.table.round(3).to_string())
    pulls = equation.runs["cook"].idxmax()
    print(f"R2 {equation.r2_in:.3f} in sample, {equation.r2_loo:.3f} left out, thesis {entry.thesis_r2:.3f}")
    print(f"the run with the largest Cook's distance: {equation.runs.loc[pulls].to_dict()}")

    table.to_csv(directory / "features.csv", index=False)
    print(f"wrote {directory / 'features.csv'}")
