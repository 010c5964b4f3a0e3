"""`python -m palpate.models DIRECTORY`: make the bundled model again."""

from __future__ import annotations

import sys
from pathlib import Path

from palpate.cli.output import console, note, showing_progress
from palpate.models import FIELD, RECIPE
from palpate.models.build import build


def main() -> None:
    """Simulate, fit, write; prints the held-out tables."""
    if len(sys.argv) != 2:
        note("palpate: name the directory of the strokes, as in: python -m palpate.models out/field")
        raise SystemExit(2)
    with showing_progress() as progress:
        fit = build(Path(sys.argv[1]), progress)
    for table in fit.tables():
        console().print(table)
    note(f"wrote {FIELD} and {RECIPE}")


if __name__ == "__main__":
    main()
