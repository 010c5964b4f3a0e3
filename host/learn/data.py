"""The strokes behind a model: simulated where they are missing, read lump by lump, split.

A model that is told its tissue:

DIR/lumps   strokes over Sobol lumps, each at three forces
DIR/rim     over lumps outside the ranges, to train on
DIR/plain   over plain tissue, for false alarms
DIR/wide    more like those of the rim, to test the domain flag on
DIR/lumps-press, rim-press, wide-press     the presses before them, each at four forces
DIR/other-press                            presses on other tissues, which the model is to notice
                                           (presses only where there are lumps enough for checks)

A model for tissue of all kinds:

DIR/lumps, DIR/press              strokes over lumps in random tissue, each at three forces; the press before
DIR/rim, DIR/rim-press            over lumps outside the ranges: most to train on, the others to be flagged
DIR/plain, DIR/plain-press        over tissue without a lump, for false alarms
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from math import log
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import UsageError
from palpate.learn.design import (
    FIELD_SETTINGS,
    OUTSIDE,
    PRESS_SETTINGS,
    inside,
    lump_cases,
    no_lump_cases,
    other_cases,
    press_cases,
    rim_cases,
)
from palpate.learn.lumps import (
    SET,
    TISSUE_FIELDS,
    LumpStrokes,
    read_lumps,
    read_pressed,
    read_presses,
    with_presses,
)
from palpate.learn.reference import Tissue, read_references
from palpate.learn.scopes import BORDER, Scope
from palpate.learn.table import TableError
from palpate.progress import ProgressCallback
from palpate.sim.probe.sensors import StrokeField
from palpate.sim.tissue import Case, Progress, Settings, Stroke, read_table, sweep
from palpate.sim.tissue.any_tissue import (
    FORCE_PARTS,
    PRESS_PARTS,
    PRESSES,
    STROKES,
    at_forces,
)

TOLD_LUMPS, LUMPS = 2048, 1300
"""How many are simulated, told the tissue and not."""
_RIM, _PLAIN, _WIDE, _OTHER = 0.25, 0.25, 0.125, 0.25
_ANY_RIM, _ANY_PLAIN = 0.3, 0.1
"""Of each of the others, for one lump."""

_PRESSED = ("lumps", "rim", "wide")
"""Parts whose strokes a press precedes."""

_LUMPS_SEED, _WIDE_SEED = 21, 23
"""Features, terms and settings were chosen on lumps of seeds 1, 5, 11, 13 and 77, not on these."""
SEED, _RIM_SEED, _PLAIN_SEED = 31, 33, 34
"""Of tissue of all kinds."""

_STILL = Settings(start_mm=0.0)
"""Plain tissue is the same everywhere: one position will do."""

_SHARE_CALIBRATION, _SHARE_TEST = 0.2, 0.35

FEWEST_LUMPS = 200
"""To train on; a model of fewer has no checks, which would not tell strange strokes from its own, and needs
no presses."""

OTHER = "other-press"
"""The part of a directory with presses on other tissues."""


@dataclass(frozen=True)
class OtherTissue:
    """A press on it at rising forces, and a stroke along it without a lump.

    kind: the field of `Case` that differs; off: by how much, of lengths as a difference of logarithms
    """

    kind: str
    off: float
    press: tuple[Stroke, ...]

    @property
    def field(self) -> StrokeField:
        """What the sensors feel."""
        return StrokeField(*self.press[-3:], press=self.press)


@dataclass(frozen=True)
class Strokes:
    """What a directory holds, lump by lump.

    Attributes
    ----------
    lumps, rim, plain, wide : lists of LumpStrokes
        `rim` and `wide` hold only lumps outside the ranges that the model is for.
    excluded : dict
        Why -> how many strokes were left out.
    others : list of OtherTissue
        What a told model is to notice by its press.
    references : mapping
        In tissue of all kinds: presses beside the lumps, by tissue.
    """

    lumps: list[LumpStrokes]
    rim: list[LumpStrokes]
    plain: list[LumpStrokes]
    excluded: dict[str, int]
    wide: list[LumpStrokes] = field(default_factory=list)
    others: list[OtherTissue] = field(default_factory=list)
    references: Mapping[Tissue, tuple[Stroke, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class Split:
    """Numbers of the lumps to train on, to calibrate on and to test on; none is in two."""

    train: NDArray[np.int64]
    calibration: NDArray[np.int64]
    test: NDArray[np.int64]


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


def prepare(
    directory: str | PathLike[str],
    lumps: int = TOLD_LUMPS,
    rim: int | None = None,
    plain: int | None = None,
    wide: int | None = None,
    workers: int | None = None,
    tissue: Mapping[str, float] | None = None,
    progress: ProgressCallback | None = None,
) -> Strokes:
    """Simulate into `directory` what it does not hold yet, and read all of it.

    Parameters
    ----------
    directory : path
        Parts that are there already are used as they are.
    lumps, rim, plain, wide : int
        How many of each to simulate; by default in proportion to the lumps.
    workers : int, optional
        Processes; by default one for each core.
    tissue : mapping, optional
        Fields of `Case` that differ from the usual tissue or probe, as gland_ratio: to fit a model of it.
    progress : callable, optional
        See `progress.ProgressCallback`.

    Raises
    ------
    UsageError
        `tissue` names a field that no case has.
    TableError
        `directory` holds strokes over another tissue.
    """
    directory = Path(directory)
    if (directory / "press").exists():
        raise TableError(
            f"{directory} holds strokes in tissue of all kinds; leave --tissue out, or name another"
        )
    tissue = check_tissue_names(tissue or {})
    rim, plain, wide = (
        round(lumps * share) if n is None else n for n, share in ((rim, _RIM), (plain, _PLAIN), (wide, _WIDE))
    )
    parts: Simulated = {
        "lumps": (lump_cases(lumps, _LUMPS_SEED, tissue=tissue), FIELD_SETTINGS),
        "rim": (rim_cases(rim, tissue=tissue), FIELD_SETTINGS),
        "plain": (no_lump_cases(plain, tissue=tissue), _STILL),
        "wide": (lump_cases(wide, _WIDE_SEED, OUTSIDE, tissue), FIELD_SETTINGS),
    }
    simulate_missing(parts, directory, workers, progress)
    strokes = read(directory)
    _check_tissue(strokes, tissue, directory)
    return pressed(strokes, directory, workers, progress)


def pressed(
    strokes: Strokes,
    directory: str | PathLike[str],
    workers: int | None = None,
    progress: ProgressCallback | None = None,
) -> Strokes:
    """The strokes of `directory` with their presses and those on other tissues, simulated where missing.

    As they are where there are too few lumps for checks.
    """
    directory = Path(directory)
    if len(split(len(strokes.lumps)).train) < FEWEST_LUMPS:
        return strokes
    presses = {f"{name}-press": press_cases(getattr(strokes, name)) for name in _PRESSED}
    presses[OTHER] = other_cases(round(_OTHER * len(strokes.lumps)), _told(strokes.lumps))
    if all(_holds(directory / name) for name in presses):
        return strokes
    simulate_missing(
        {name: (cases, PRESS_SETTINGS) for name, cases in presses.items()}, directory, workers, progress
    )
    return read(directory)


def _told(lumps: Sequence[LumpStrokes]) -> dict[str, Any]:
    """The tissue and the probe that these lumps share, as fields of `Case`."""
    return {name: getattr(lumps[0].case, name) for name in TISSUE_FIELDS}


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


def _check_tissue(strokes: Strokes, tissue: dict[str, float], directory: Path) -> None:
    """Refuse strokes over another tissue than the one asked for: they would be fitted silently."""
    usual = Case(10.0, 0.8, 10.0)
    for lump in (*strokes.lumps[:1], *strokes.rim[:1], *strokes.wide[:1]):
        for name in TISSUE_FIELDS:
            wanted, found = tissue.get(name, getattr(usual, name)), getattr(lump.case, name)
            if wanted != found:
                raise TableError(
                    f"{directory} holds strokes with {name} {_plain(found)}, not {_plain(wanted)}; "
                    "name another directory"
                )


def _plain(value: object) -> str:
    """A field of a case as text: most are numbers, a lump's shape is a word."""
    return f"{value:g}" if isinstance(value, int | float) else str(value)


def sweep_progress(what: str, progress: ProgressCallback | None) -> Callable[[Progress], None] | None:
    """What a sweep calls with its `Progress`, which is passed on to `progress`."""
    return None if progress is None else lambda p: progress(what, p.done, p.total)


def read(directory: str | PathLike[str]) -> Strokes:
    """The strokes of a directory, lump by lump; `TableError` if it holds none over lumps."""
    directory = Path(directory)
    found: dict[str, list[LumpStrokes]] = {}
    excluded: dict[str, int] = {}
    for name in ("lumps", "rim", "plain", "wide"):
        home = directory / name
        if not _holds(home):
            found[name] = []
            continue
        found[name], failed, alone = read_lumps(home)
        _count(excluded, f"{name}: no equilibrium found", failed)
        _count(excluded, f"{name}: another force of the lump is missing", alone)
    if not found["lumps"]:
        raise TableError(f"{directory} holds no strokes over lumps at two forces or more")
    within = [inside(lump.case) for lump in found["wide"]]
    _count(excluded, "wide: inside the training ranges, so no test of the domain", sum(within))
    found["wide"] = [lump for lump, is_in in zip(found["wide"], within) if not is_in]
    for name in _PRESSED:
        found[name] = with_presses(found[name], directory / f"{name}-press")
    others = read_others(directory / OTHER, _told(found["lumps"]))
    return Strokes(found["lumps"], found["rim"], found["plain"], excluded, found["wide"], others)


def split(n: int, seed: int = 1) -> Split:
    """Lumps 0 to n - 1 dealt out at random: 45 % to train, 20 % to calibrate, 35 % to test."""
    order = np.random.default_rng(seed).permutation(n)
    test, calibration = round(n * _SHARE_TEST), round(n * _SHARE_CALIBRATION)
    return Split(
        np.sort(order[test + calibration :]),
        np.sort(order[test : test + calibration]),
        np.sort(order[:test]),
    )


def _count(excluded: dict[str, int], why: str, n: int) -> None:
    if n:
        excluded[why] = excluded.get(why, 0) + n


def read_others(home: Path, tissue: Mapping[str, Any] | None = None) -> list[OtherTissue]:
    """The other tissues that `home` holds, none where it holds nothing; tissue as for `other_cases`."""
    if not _holds(home):
        return []
    usual = Case.without_lump(10.0, **(tissue or {}))
    out = []
    for press in read_presses(home):
        radius = log(press[0].case.probe_radius_mm / usual.probe_radius_mm)
        stiffening = press[0].case.fat_stiffening - usual.fat_stiffening
        kind, off = ("probe_radius_mm", radius) if radius else ("fat_stiffening", stiffening)
        out.append(OtherTissue(kind, off, press))
    return out


def prepare_strokes(
    directory: str | PathLike[str],
    lumps: int = LUMPS,
    workers: int | None = None,
    progress: ProgressCallback | None = None,
    scope: Scope = BORDER,
) -> Strokes:
    """Simulate into `directory` what it does not hold yet of the scope's design, and read all of it.

    Raises
    ------
    TableError
        `directory` holds strokes over one tissue, for a model that is told it.
    """
    directory = Path(directory)
    check_tissue(directory)
    design = scope.design
    assert design is not None
    drawn = design.lumps(lumps, SEED)
    rim = design.rim(round(_ANY_RIM * lumps), _RIM_SEED)
    plain = design.plain(round(_ANY_PLAIN * lumps), _PLAIN_SEED)
    parts: Simulated = {
        "press": (at_forces(drawn, PRESS_PARTS), PRESSES),
        "lumps": (at_forces(drawn, FORCE_PARTS), STROKES),
        "rim-press": (at_forces(rim, PRESS_PARTS), PRESSES),
        "rim": (at_forces(rim, FORCE_PARTS), STROKES),
        "plain-press": (at_forces(plain, PRESS_PARTS), PRESSES),
        "plain": (at_forces(plain, FORCE_PARTS), replace(STROKES, far_start_mm=None, start_mm=0.0)),
    }
    simulate_missing(parts, directory, workers, progress)
    return read_strokes(directory)


def lie_anywhere(directory: Path) -> bool | None:
    """Whether the lumps that `directory` holds need not lie on the border; None where it holds none."""
    if not _holds(directory / "lumps"):
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


def read_strokes(directory: Path) -> Strokes:
    """The strokes of a directory, lump by lump."""
    excluded: dict[str, int] = {}
    found = {}
    for name in ("lumps", "rim", "plain"):
        press = directory / ("press" if name == "lumps" else f"{name}-press")
        found[name] = read_pressed(directory / name, press)
        for home in (directory / name, press):
            if failed := int((read_table(home)["status"] != "ok").sum()):
                excluded[f"{home.name}: no equilibrium found"] = failed
    references = read_references(directory / "press")
    return Strokes(found["lumps"], found["rim"], found["plain"], excluded, references=references)
