"""Make the strokes for the tests of a told model: `python -m tests.host.learn.make_data DIR`.

96 lumps with their presses, a quarter as many outside the ranges, plain and other tissues, and the features
of the thesis' thirty runs; a few minutes.
"""

from __future__ import annotations

import sys
from pathlib import Path

from palpate.learn.data import prepare_strokes
from palpate.learn.scopes import TOLD
from palpate.learn.thesis.runs import features_table
from palpate.sim.tissue import THESIS_CODES, Case, load_strokes, sweep


def main(directory: str) -> None:
    """Simulate into `directory` what the tests read from tests/host/learn/data."""
    home = Path(directory)
    prepare_strokes(home, 96, scope=TOLD)
    sweep([Case.from_code(code) for code in THESIS_CODES], out_dir=home / "thesis")
    features_table(load_strokes(home / "thesis")).round(7).to_csv(home / "thesis_runs.csv", index=False)


if __name__ == "__main__":
    main(sys.argv[1])
