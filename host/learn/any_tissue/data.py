"""The strokes behind a model that is not told its tissue: simulated where they are missing.

DIR/lumps, DIR/press              strokes over lumps in random tissue, each at three forces; the press before
DIR/rim, DIR/rim-press            over lumps outside the ranges: most to train on, the others to be flagged
DIR/plain, DIR/plain-press        over tissue without a lump, for false alarms
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from palpate.learn.any_tissue.observed import TissueLump, read_set
from palpate.learn.any_tissue.reference import Tissue, read_references
from palpate.learn.any_tissue.study import SEED
from palpate.learn.field.data import sweep_progress
from palpate.learn.table import TableError
from palpate.progress import ProgressCallback
from palpate.sim.tissue import Case, Settings, Stroke, read_table, sweep
from palpate.sim.tissue.any_tissue import (
    FORCE_PARTS,
    PRESS_PARTS,
    PRESSES,
    STROKES,
    TissueRanges,
    at_forces,
    plain_lumps,
    random_lumps,
    rim_lumps,
)
from palpate.sim.tissue.anywhere import anywhere_lumps, anywhere_plain, anywhere_rim

LUMPS = 1300
_RIM, _PLAIN = 0.3, 0.1
"""Of each of the others, for one lump."""

_RIM_SEED, _PLAIN_SEED = 33, 34
_STILL = Settings(start_mm=0.0)
"""Plain tissue is the same everywhere: one position will do."""

Cases = Callable[[], list[Case]]


@dataclass(frozen=True)
class Design:
    """Which lumps: so many of a seed, at their middle force; those outside the ranges; tissue without any."""

    lumps: Callable[[int, int], list[Case]]
    rim: Callable[[int, int], list[Case]]
    plain: Callable[[int, int], list[Case]]


ON_BORDER = Design(lambda n, seed: random_lumps(n, seed, TissueRanges()), rim_lumps, plain_lumps)
ANYWHERE = Design(anywhere_lumps, anywhere_rim, anywhere_plain)


@dataclass(frozen=True)
class TissueStrokes:
    """What a directory holds.

    `excluded`: reason -> how many strokes were left out; `references`: presses beside the lumps, by tissue.
    """

    lumps: list[TissueLump]
    rim: list[TissueLump]
    plain: list[TissueLump]
    excluded: dict[str, int]
    references: Mapping[Tissue, tuple[Stroke, ...]]


def prepare_strokes(
    directory: str | PathLike[str],
    lumps: int = LUMPS,
    workers: int | None = None,
    progress: ProgressCallback | None = None,
    design: Design = ON_BORDER,
) -> TissueStrokes:
    """Simulate into `directory` what it does not hold yet of the design, and read all of it.

    Raises
    ------
    TableError
        `directory` holds strokes over one tissue, for a model that is told it.
    """
    directory = Path(directory)
    check_tissue(directory)
    drawn = design.lumps(lumps, SEED)
    rim = design.rim(round(_RIM * lumps), _RIM_SEED)
    plain = design.plain(round(_PLAIN * lumps), _PLAIN_SEED)
    parts: dict[str, tuple[Cases, Settings]] = {
        "press": (lambda: at_forces(drawn, PRESS_PARTS), PRESSES),
        "lumps": (lambda: at_forces(drawn, FORCE_PARTS), STROKES),
        "rim-press": (lambda: at_forces(rim, PRESS_PARTS), PRESSES),
        "rim": (lambda: at_forces(rim, FORCE_PARTS), STROKES),
        "plain-press": (lambda: at_forces(plain, PRESS_PARTS), PRESSES),
        "plain": (lambda: at_forces(plain, FORCE_PARTS), _STILL),
    }
    for name, (cases, settings) in parts.items():
        if not (directory / name / "strokes.parquet").exists():
            report = sweep_progress(f"simulating {name}", progress)
            sweep(cases(), settings, directory / name, workers=workers, progress=report)
    return read_strokes(directory)


def lie_anywhere(directory: Path) -> bool | None:
    """Whether the lumps that `directory` holds need not lie on the border; None where it holds none."""
    if not (directory / "lumps" / "strokes.parquet").exists():
        return None
    table = read_table(directory / "lumps")
    return "fat_mm" in table and bool(table["fat_mm"].notna().any())  # which old sets do not have


def check_tissue(directory: Path) -> None:
    """`TableError` where the directory's lumps lie in one tissue."""
    if (directory / "lumps").exists() and not (directory / "press").exists():
        raise TableError(
            f"{directory} holds strokes in one tissue; say which (--tissue thesis, or as --tissue "
            "gland_ratio=8), or name another directory"
        )


def read_strokes(directory: Path) -> TissueStrokes:
    """The strokes of a directory, lump by lump."""
    excluded: dict[str, int] = {}
    found = {}
    for name in ("lumps", "rim", "plain"):
        press = directory / ("press" if name == "lumps" else f"{name}-press")
        found[name] = read_set(directory / name, press)
        for home in (directory / name, press):
            if failed := int((read_table(home)["status"] != "ok").sum()):
                excluded[f"{home.name}: no equilibrium found"] = failed
    references = read_references(directory / "press")
    return TissueStrokes(found["lumps"], found["rim"], found["plain"], excluded, references)
