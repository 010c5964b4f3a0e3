"""The finite-element strokes behind a field model: simulated where they are missing, split by lump.

DIR/lumps   strokes over Sobol lumps, each at three forces
DIR/rim     over lumps outside the ranges, to train on
DIR/plain   over plain tissue, for false alarms
DIR/wide    more like those of the rim, to test the domain flag on
DIR/lumps-press, rim-press, wide-press     the presses before them, each at four forces
DIR/other-press                            presses on other tissues, which the model is to notice
                                           (presses only where there are lumps enough for checks)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from difflib import get_close_matches
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import UsageError
from palpate.learn.field.design import (
    FIELD_SETTINGS,
    OUTSIDE,
    LumpStrokes,
    by_lump,
    inside,
    lump_cases,
    no_lump_cases,
    rim_cases,
)
from palpate.learn.field.presses import (
    FEWEST_LUMPS,
    OTHER,
    OtherTissue,
    other_cases,
    press_cases,
    read_others,
    with_presses,
)
from palpate.learn.table import TableError
from palpate.progress import ProgressCallback
from palpate.sim.probe.sensors import StrokeField
from palpate.sim.tissue import Case, Progress, Settings, load_strokes, read_table, sweep
from palpate.sim.tissue.any_tissue import PRESSES

LUMPS = 2048
_RIM, _PLAIN, _WIDE, _OTHER = 0.25, 0.25, 0.125, 0.25
"""Of each of the others, for one lump."""

_PRESSED = ("lumps", "rim", "wide")
"""Parts whose strokes a press precedes."""

_LUMPS_SEED, _WIDE_SEED = 21, 23
"""Features, terms and settings were chosen on lumps of seeds 1, 5, 11, 13 and 77, not on these."""

_PLAIN_SETTINGS = Settings(start_mm=0.0)
"""Plain tissue is the same everywhere: one position will do."""

_SHARE_CALIBRATION, _SHARE_TEST = 0.2, 0.35

TISSUE_FIELDS = tuple(f.name for f in fields(Case) if f.name not in ("d_mm", "h", "E_ratio", "F_rel"))
"""What a case says of tissue and probe: all but the lump and the force."""


@dataclass(frozen=True)
class FieldStrokes:
    """The lumps of a directory, and what had to be left out.

    Attributes
    ----------
    lumps, rim, plain, wide : lists of LumpStrokes
        `rim` and `wide` hold only lumps outside the ranges that the model is for.
    excluded : dict
        Why -> how many strokes.
    others : list of OtherTissue
        What the model is to notice by its press.
    """

    lumps: list[LumpStrokes]
    rim: list[LumpStrokes]
    plain: list[LumpStrokes]
    wide: list[LumpStrokes]
    excluded: dict[str, int]
    others: list[OtherTissue] = field(default_factory=list)


@dataclass(frozen=True)
class Split:
    """Numbers of the lumps to train on, to calibrate on and to test on; none is in two."""

    train: NDArray[np.int64]
    calibration: NDArray[np.int64]
    test: NDArray[np.int64]


def prepare(
    directory: str | PathLike[str],
    lumps: int = LUMPS,
    rim: int | None = None,
    plain: int | None = None,
    wide: int | None = None,
    workers: int | None = None,
    tissue: Mapping[str, float] | None = None,
    progress: ProgressCallback | None = None,
) -> FieldStrokes:
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
    parts: dict[str, tuple[Callable[[], list[Case]], Settings]] = {
        "lumps": (lambda: lump_cases(lumps, _LUMPS_SEED, tissue=tissue), FIELD_SETTINGS),
        "rim": (lambda: rim_cases(rim, tissue=tissue), FIELD_SETTINGS),
        "plain": (lambda: no_lump_cases(plain, tissue=tissue), _PLAIN_SETTINGS),
        "wide": (lambda: lump_cases(wide, _WIDE_SEED, OUTSIDE, tissue), FIELD_SETTINGS),
    }
    wanted = {"lumps": lumps, "rim": rim, "plain": plain, "wide": wide}
    for name, (cases, settings) in parts.items():
        home = directory / name
        if (home / "strokes.parquet").exists() or not wanted[name]:
            continue
        sweep(
            cases(), settings, home, workers=workers, progress=sweep_progress(f"simulating {name}", progress)
        )
    strokes = read(directory)
    _check_tissue(strokes, tissue, directory)
    return pressed(strokes, directory, workers, progress)


def pressed(
    strokes: FieldStrokes,
    directory: str | PathLike[str],
    workers: int | None = None,
    progress: ProgressCallback | None = None,
) -> FieldStrokes:
    """The strokes of `directory` with their presses and those on other tissues, simulated where missing.

    As they are where there are too few lumps for checks.
    """
    directory = Path(directory)
    if len(split(len(strokes.lumps)).train) < FEWEST_LUMPS:
        return strokes
    presses = {f"{name}-press": press_cases(getattr(strokes, name)) for name in _PRESSED}
    presses[OTHER] = other_cases(round(_OTHER * len(strokes.lumps)), _told(strokes.lumps))
    missing = [name for name in presses if not (directory / name / "strokes.parquet").exists()]
    for name in filter(presses.get, missing):
        report = sweep_progress(f"simulating {name}", progress)
        sweep(presses[name], PRESSES, directory / name, workers=workers, progress=report)
    return read(directory) if missing else strokes


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
    return any((directory / name).exists() for name in ("press", "lumps", "balls.parquet"))


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


def _check_tissue(strokes: FieldStrokes, tissue: dict[str, float], directory: Path) -> None:
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


def read(directory: str | PathLike[str]) -> FieldStrokes:
    """The strokes of a directory, lump by lump; `TableError` if it holds none over lumps."""
    directory = Path(directory)
    found: dict[str, list[LumpStrokes]] = {}
    excluded: dict[str, int] = {}
    for name in ("lumps", "rim", "plain", "wide"):
        home = directory / name
        if not (home / "strokes.parquet").exists():
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
    return FieldStrokes(found["lumps"], found["rim"], found["plain"], found["wide"], excluded, others)


def of_the_command(strokes: FieldStrokes) -> bool:
    """Whether these are the lumps that `prepare` simulates now, and not those of another seed."""
    first = lump_cases(1, _LUMPS_SEED)[0]
    return any(lump.low.case == first for lump in strokes.lumps)


def read_lumps(home: Path) -> tuple[list[LumpStrokes], int, int]:
    """Lumps of a sweep's directory, how many strokes failed, and how many have no partner."""
    failed = int((read_table(home)["status"] != "ok").sum())
    lumps, alone = by_lump(load_strokes(home))
    return lumps, failed, len(alone)


def split(n: int, seed: int = 1) -> Split:
    """Lumps 0 to n - 1 dealt out at random: 45 % to train, 20 % to calibrate, 35 % to test."""
    order = np.random.default_rng(seed).permutation(n)
    test, calibration = round(n * _SHARE_TEST), round(n * _SHARE_CALIBRATION)
    return Split(
        np.sort(order[test + calibration :]),
        np.sort(order[test : test + calibration]),
        np.sort(order[:test]),
    )


def stroke_fields(lumps: Sequence[LumpStrokes]) -> list[StrokeField]:
    """The sensor model's view of each lump."""
    return [StrokeField(*lump.strokes, press=lump.press) for lump in lumps]


def _count(excluded: dict[str, int], why: str, n: int) -> None:
    if n:
        excluded[why] = excluded.get(why, 0) + n
