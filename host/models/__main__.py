"""`python -m palpate.models NAME DIRECTORY`: make a model that comes with Palpate again.

`python -m palpate.models emulator SET...` makes the emulator of strokes over solid lumps from kept sets, and
`python -m palpate.models plane DIRECTORY` that of frames over cylinders, computed into the directory.
"""

from __future__ import annotations

import sys
from pathlib import Path

from palpate.console import console, note, showing_progress
from palpate.models import NAMES, emulator_path, path, plane_emulator_path, recipe_path
from palpate.models.build import EMULATOR, PLANE, build, build_emulator, build_plane_emulator


def main() -> None:
    """Simulate, fit, write; prints the held-out tables."""
    if len(sys.argv) > 2 and sys.argv[1] == EMULATOR:
        build_emulator([Path(word) for word in sys.argv[2:]])
        note(f"wrote {emulator_path()} and {emulator_path().with_suffix('.recipe.json')}")
        return
    if len(sys.argv) == 3 and sys.argv[1] == PLANE:
        with showing_progress() as progress:
            wrong = build_plane_emulator(Path(sys.argv[2]), progress)
        note(", ".join(f"{words} {error:.2f} %" for words, error in wrong.items()))
        note(f"wrote {plane_emulator_path()}")
        return
    if len(sys.argv) != 3 or sys.argv[1] not in NAMES:
        note(
            f"palpate: name the model ({', '.join([*NAMES, EMULATOR, PLANE])}) and its strokes' directory, "
            "as in: python -m palpate.models field out/field"
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
