"""`python -m palpate.models NAME DIRECTORY`: make a model that comes with Palpate again.

`python -m palpate.models emulator SET...` makes the emulator of strokes over solid lumps from kept sets.
"""

from __future__ import annotations

import sys
from pathlib import Path

from palpate.console import console, note, showing_progress
from palpate.models import NAMES, emulator_path, path, recipe_path
from palpate.models.build import EMULATOR, build, build_emulator


def main() -> None:
    """Simulate, fit, write; prints the held-out tables."""
    if len(sys.argv) > 2 and sys.argv[1] == EMULATOR:
        build_emulator([Path(word) for word in sys.argv[2:]])
        note(f"wrote {emulator_path()} and {emulator_path().with_suffix('.recipe.json')}")
        return
    if len(sys.argv) != 3 or sys.argv[1] not in NAMES:
        note(
            f"palpate: name the model ({', '.join([*NAMES, EMULATOR])}) and its strokes' directory, as in: "
            "python -m palpate.models field out/field"
        )
        raise SystemExit(2)
    name = sys.argv[1]
    with showing_progress() as progress:
        fit = build(name, Path(sys.argv[2]), progress)
    for table in fit.tables():
        console().print(table)
    note(f"wrote {path(name)} and {recipe_path(name)}")


if __name__ == "__main__":
    main()
