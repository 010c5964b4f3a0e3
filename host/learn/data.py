"""The strokes behind a model of cylinders: simulated where they are missing, read lump by lump.

DIR/lumps, DIR/press              strokes over lumps, each at three forces; the press before them
DIR/rim, DIR/rim-press            over lumps outside the ranges: most to train on, the others to be flagged
DIR/plain, DIR/plain-press        over tissue without a lump, for false alarms
DIR/other-press                   presses on other tissues, which a model that is told its own is to notice
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from math import log
from os import PathLike
from pathlib import Path

from palpate.errors import UsageError
from palpate.learn.lumps import SET, TISSUE_FIELDS, LumpStrokes, read_pressed, read_presses
from palpate.learn.reference import Tissue, read_references
from palpate.learn.scopes import BORDER, Scope
from palpate.learn.table import TableError
from palpate.progress import ProgressCallback
from palpate.sim.tissue import Case, Progress, Settings, Stroke, read_table, sweep
from palpate.sim.tissue.any_tissue import (
    FORCE_PARTS,
    PRESS_PARTS,
    PRESSES,
    REFERENCE_PARTS,
    STROKES,
    at_forces,
)

LUMPS = 1300
"""How many are simulated."""
_RIM, _PLAIN, _OTHER = 0.3, 0.1, 0.25
"""Of each of the others, for one lump."""
SEED, _RIM_SEED, _PLAIN_SEED, _OTHER_SEED = 31, 33, 34, 41
"""Features, terms and settings were chosen on lumps of seeds 1, 5, 11, 13 and 77."""


@dataclass(frozen=True)
class OtherTissue:
    """A press on it at rising forces, and a stroke along it without a lump.

    kind: the field of `Case` that differs; off: by how much, of lengths as a difference of logarithms
    """

    kind: str
    off: float
    strokes: LumpStrokes


@dataclass(frozen=True)
class Strokes:
    """What a directory holds, lump by lump.

    Attributes
    ----------
    lumps, rim, plain : lists of LumpStrokes
        `rim` holds only lumps outside the ranges that the model is for.
    excluded : dict
        Why -> how many strokes were left out.
    references : mapping
        Presses beside the lumps, by tissue.
    others : list of OtherTissue
        What a told model is to notice by its press.
    """

    lumps: list[LumpStrokes]
    rim: list[LumpStrokes]
    plain: list[LumpStrokes]
    excluded: dict[str, int]
    references: Mapping[Tissue, tuple[Stroke, ...]] = field(default_factory=dict)
    others: list[OtherTissue] = field(default_factory=list)


OTHER = "other-press"
"""The part of a directory with presses on other tissues."""
Simulated = Mapping[str, tuple[list[Case], Settings]]
"""What is simulated, by the part of the directory."""


def simulate_missing(
    parts: Simulated, directory: Path, workers: int | None, progress: ProgressCallback | None
) -> None:
    """Sweep the parts that the directory does not hold."""
    for name, (cases, settings) in parts.items():
        if cases and not _holds(directory / name):
            report = sweep_progress(f"simulating {name}", progress)
            sweep(cases, settings, directory / name, workers=workers, progress=report)


def _holds(home: Path) -> bool:
    return (home / "strokes.parquet").exists()


def check_begun(directory: str | PathLike[str], lumps: int | None) -> None:
    """`UsageError` where a mistyped name would begin thousands of simulations.

    That is: nobody has said how many lumps are wanted, and the directory holds something else, or is not
    there while a neighbour of nearly its name is.
    """
    directory = Path(directory)
    if lumps is not None or begun(directory):
        return
    doubt = ""
    if directory.exists():
        if not directory.is_dir() or any(directory.iterdir()):
            doubt = "holds no strokes for a field model"
    elif like := _alike(directory):
        doubt = f"does not exist, {like} does"
    if doubt:
        raise UsageError(
            f"{directory} {doubt}; check the name, or say how many lumps to simulate into it (--lumps N)"
        )


def begun(directory: Path) -> bool:
    """Whether a fit has simulated into this directory, or a set was kept there."""
    return any((directory / name).exists() for name in ("press", "lumps", SET))


def _alike(directory: Path) -> Path | None:
    """The neighbour that holds strokes and has nearly this name."""
    home = directory.parent
    names = [found.name for found in home.iterdir() if begun(found)] if home.is_dir() else []
    close = get_close_matches(directory.name, names, n=1)
    return home / close[0] if close else None


def check_tissue_names(tissue: Mapping[str, float]) -> dict[str, float]:
    """The same fields; `UsageError` names one that is no property of tissue or probe."""
    for name in tissue:
        if name not in TISSUE_FIELDS:
            known = ", ".join(sorted(TISSUE_FIELDS))
            raise UsageError(f"there is no {name!r} in a case's tissue; there are {known}")
    return dict(tissue)


def sweep_progress(what: str, progress: ProgressCallback | None) -> Callable[[Progress], None] | None:
    """What a sweep calls with its `Progress`, which is passed on to `progress`."""
    return None if progress is None else lambda p: progress(what, p.done, p.total)


def prepare_strokes(
    directory: str | PathLike[str],
    lumps: int = LUMPS,
    workers: int | None = None,
    progress: ProgressCallback | None = None,
    scope: Scope = BORDER,
) -> Strokes:
    """Simulate into `directory` what it does not hold yet of the scope's design, and read all of it.

    Parameters
    ----------
    directory : path
        Parts that are there already are used as they are.
    lumps : int
        How many to simulate; of the other parts as many as go with them.
    workers : int, optional
        Processes; by default one for each core.
    progress : callable, optional
        See `progress.ProgressCallback`.
    scope : Scope
        Of cylinders; `scopes.told` has one for a tissue of your own.

    Raises
    ------
    TableError
        `directory` holds strokes in tissue that the scope is not for.
    """
    directory = Path(directory)
    check_tissue(directory, scope)
    design = scope.design
    assert design is not None
    drawn = design.lumps(lumps, SEED)
    rim = design.rim(round(_RIM * lumps), _RIM_SEED)
    plain = design.plain(round(_PLAIN * lumps), _PLAIN_SEED)
    others = design.others(round(_OTHER * lumps), _OTHER_SEED) if design.others else []
    parts: Simulated = {
        "press": (at_forces(drawn, PRESS_PARTS), PRESSES),
        "lumps": (at_forces(drawn, FORCE_PARTS), STROKES),
        "rim-press": (at_forces(rim, PRESS_PARTS), PRESSES),
        "rim": (at_forces(rim, FORCE_PARTS), STROKES),
        "plain-press": (at_forces(plain, PRESS_PARTS), PRESSES),
        "plain": (at_forces(plain, FORCE_PARTS), replace(STROKES, far_start_mm=None, start_mm=0.0)),
        OTHER: (at_forces(others, REFERENCE_PARTS), PRESSES),
    }
    simulate_missing(parts, directory, workers, progress)
    return read_strokes(directory)


def _held(directory: Path) -> list[Case]:
    """The cases of the lumps that `directory` holds, every force its own."""
    if not _holds(directory / "lumps"):
        return []
    return [Case.from_code(code) for code in read_table(directory / "lumps", series=False)["code"]]


def lie_anywhere(directory: Path) -> bool | None:
    """Whether the lumps that `directory` holds need not lie on the border; None where it holds none."""
    cases = _held(directory)
    return any(case.fat_mm is not None for case in cases) if cases else None


def check_tissue(directory: Path, scope: Scope) -> None:
    """`TableError` where the directory's lumps lie in tissue that the scope is not for: they would be fitted
    silently."""
    cases = _held(directory)
    if not cases:
        return
    if not _holds(directory / "press"):
        raise TableError(f"{directory} holds strokes without their presses; name another directory")
    first = cases[0]
    one = all(getattr(case, name) == getattr(first, name) for case in cases for name in TISSUE_FIELDS)
    if scope.tissue is None:
        if one:
            raise TableError(
                f"{directory} holds strokes in one tissue; say which (--tissue thesis, or as --tissue "
                "gland_ratio=8), or name another directory"
            )
        return
    if not one:
        raise TableError(
            f"{directory} holds strokes in tissue of all kinds; leave --tissue out, or name another"
        )
    usual = Case(10.0, 0.8, 10.0)
    for name in TISSUE_FIELDS:
        wanted, found = scope.tissue.get(name, getattr(usual, name)), getattr(first, name)
        if wanted != found:
            raise TableError(
                f"{directory} holds strokes with {name} {_plain(found)}, not {_plain(wanted)}; "
                "name another directory"
            )


def _plain(value: object) -> str:
    """A field of a case as text: most are numbers, a lump's shape is a word."""
    return f"{value:g}" if isinstance(value, int | float) else str(value)


def read_strokes(directory: str | PathLike[str]) -> Strokes:
    """The strokes of a directory, lump by lump; `TableError` if it holds none over lumps."""
    directory = Path(directory)
    if not _holds(directory / "lumps"):
        raise TableError(f"{directory} holds no strokes over lumps")
    excluded: dict[str, int] = {}
    found = {}
    for name in ("lumps", "rim", "plain"):
        press = directory / ("press" if name == "lumps" else f"{name}-press")
        found[name] = read_pressed(directory / name, press)
        for home in (directory / name, press):
            if failed := int((read_table(home)["status"] != "ok").sum()):
                excluded[f"{home.name}: no equilibrium found"] = failed
    references = read_references(directory / "press")
    others = read_others(directory / OTHER, found["lumps"][0].case)
    return Strokes(found["lumps"], found["rim"], found["plain"], excluded, references, others)


def read_others(home: Path, own: Case) -> list[OtherTissue]:
    """The other tissues that `home` holds, none where it holds nothing; own: a case of the model's tissue."""
    if not _holds(home):
        return []
    out = []
    for press in read_presses(home):
        radius = log(press[0].case.probe_radius_mm / own.probe_radius_mm)
        stiffening = press[0].case.fat_stiffening - own.fat_stiffening
        kind, off = ("probe_radius_mm", radius) if radius else ("fat_stiffening", stiffening)
        out.append(OtherTissue(kind, off, LumpStrokes(press[-len(FORCE_PARTS) :], press)))
    return out
