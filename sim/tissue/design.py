"""Designs: which cases a sweep runs."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import MISSING, dataclass, fields, replace
from pathlib import Path

import numpy as np

from palpate.files import read_limited
from palpate.sim.tissue.any_tissue import PRESSES, STROKES, any_tissue_cases, press_cases
from palpate.sim.tissue.anywhere import anywhere_cases, anywhere_press_cases
from palpate.sim.tissue.case import Case
from palpate.sim.tissue.draws import LumpRanges
from palpate.sim.tissue.errors import CaseError
from palpate.sim.tissue.settings import Settings
from palpate.sim.tissue.solid.design import ball_cases, deep_cases, rim_cases, soft_gland_cases
from palpate.sim.tissue.thesis_runs import THESIS_CODES


@dataclass(frozen=True)
class Ranges(LumpRanges):
    """What a Sobol design covers; E is even in E^-2/3, the rest in themselves."""

    F_rel: tuple[float, float] = (0.3, 1.0)
    probe_radius_mm: tuple[float, float] | None = None


USUAL = Ranges()
WIDEST = Ranges((4.0, 25.0), (0.2, 2.0), (1.0, 1000.0), (0.1, 1.2), (25.0, 100.0))


def read_design(text: str) -> list[Case]:
    """Cases of `thesis`, `one-factor`, `NAME:N[:SEED]` with a name of `DRAWN`, `balls` (which is
    `balls:1000`), or a file (CSV of fields, or codes); of several joined by +, all.

    Raises
    ------
    CaseError
        The design or a case of it cannot be read.
    """
    path = Path(text)
    if "+" in text and not path.exists():
        return [case for part in text.split("+") for case in read_design(part)]
    if text == "thesis":
        return [Case.from_code(code) for code in THESIS_CODES]
    if text == "one-factor":
        return one_factor_cases()
    name, *numbers = text.split(":")
    if name in DRAWN and not (text == "balls" and path.exists()):
        given = numbers if text != "balls" else ["1000"]
        try:
            n, seed = map(int, given if len(given) > 1 else (*given, "1"))
        except ValueError:
            n, seed = 0, 0
        if n < 1 or seed < 0:
            raise CaseError(f"{text!r} is not a design; write {name}:N or {name}:N:SEED")
        return DRAWN[name](n, seed)
    if not path.is_file():
        drawn = ", ".join(f"{name}:N:SEED" for name in DRAWN)
        raise CaseError(f"{text!r} is not a design (thesis, one-factor, {drawn}) and not a file of cases")
    return _read_file(path)


def settings_of(text: str, hx_mm: float) -> Settings:
    """How a design's cases are to be simulated: those of unknown tissue start further off, or press only.

    Raises
    ------
    CaseError
        Designs are joined that are simulated differently.
    """
    names = [part.split(":")[0] for part in text.split("+")]
    usual = {_USUAL.get(name, Settings()) for name in names}
    if len(usual) > 1:
        raise CaseError(f"{text!r}: strokes from elsewhere, or presses, are swept apart from the others")
    return replace(usual.pop(), hx_mm=hx_mm)


def sobol_cases(n: int, seed: int, ranges: Ranges = USUAL) -> list[Case]:
    """`n` scrambled Sobol points over `ranges`; the same seed gives the same cases."""
    from scipy.stats import qmc

    bits = max(0, (n - 1).bit_length())
    columns = 4 + (ranges.probe_radius_mm is not None)
    points = qmc.Sobol(columns, seed=np.random.default_rng(seed)).random_base2(bits)[:n]

    def spread(column: int, limits: tuple[float, float]) -> np.ndarray:
        return limits[0] + (limits[1] - limits[0]) * points[:, column]

    low, high = ranges.E_ratio
    E = spread(2, (high ** (-2 / 3), low ** (-2 / 3))) ** -1.5
    parts = [spread(0, ranges.d_mm), spread(1, ranges.h), np.clip(E, low, high), spread(3, ranges.F_rel)]
    names = ("d_mm", "h", "E_ratio", "F_rel")
    cases = [Case(**dict(zip(names, map(float, row)))) for row in zip(*parts)]  # type: ignore[arg-type]
    if ranges.probe_radius_mm is not None:
        radii = spread(4, ranges.probe_radius_mm)
        cases = [replace(case, probe_radius_mm=float(radius)) for case, radius in zip(cases, radii)]
    return cases


def one_factor_cases() -> list[Case]:
    """One input changed at a time round the reference, and the strain-force curves (Figures 12 to 16)."""
    reference = Case.from_code(THESIS_CODES[0])
    forces = (0.2, 0.4, 0.6, 0.8, 1.0)
    lumps = [replace(reference, E_ratio=E) for E in (1.0, 2.0, 5.0, 10.0, 50.0, 1000.0)]
    lumps.append(Case.from_code("d10h08eNLf10"))
    lumps += [replace(reference, d_mm=d) for d in (5.0, 15.0, 20.0)]
    lumps += [replace(reference, h=h) for h in (0.3, 0.5, 1.2, 1.5)]
    return [replace(case, F_rel=F) for case in lumps for F in forces]


DRAWN: dict[str, Callable[[int, int], list[Case]]] = {
    "sobol": sobol_cases,
    "balls": ball_cases,
    "balls-soft": soft_gland_cases,
    "balls-deep": deep_cases,
    "balls-rim": rim_cases,
    "any": any_tissue_cases,
    "any-press": press_cases,
    "anywhere": anywhere_cases,
    "anywhere-press": anywhere_press_cases,
}
"""Designs drawn at random, by name: of a number and a seed."""
_USUAL = {"any": STROKES, "anywhere": STROKES, "any-press": PRESSES, "anywhere-press": PRESSES}
"""How their cases are simulated, where not as any other."""


def _read_file(path: Path) -> list[Case]:
    try:
        text = read_limited(path, 1 << 26).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError):
        raise CaseError(f"{path} cannot be read as text; give a file of cases") from None
    lines = [line for line in text.splitlines() if line.strip()]
    if not lines:
        raise CaseError(f"{path} holds no cases")
    known = {f.name for f in fields(Case)}
    header = [name.strip() for name in lines[0].split(",")]
    if not known & set(header):
        return [_code(line, path) for line in lines if not line.lstrip().startswith("#")]
    if twice := {name for name in header if header.count(name) > 1}:
        raise CaseError(f"{path} has a column twice: {', '.join(sorted(twice))}")
    if unknown := set(header) - known:
        raise CaseError(f"{path} has unknown columns: {', '.join(sorted(unknown))}")
    needed = [f.name for f in fields(Case) if f.default is MISSING and f.default_factory is MISSING]
    if lacking := [name for name in needed if name not in header]:
        raise CaseError(f"{path} lacks the columns {', '.join(lacking)}")
    cases = []
    for number, row in enumerate(csv.reader(lines[1:]), start=2):
        if len(row) != len(header):
            raise CaseError(f"{path}, line {number}: {len(row)} cells for {len(header)} columns")
        try:
            words = {name: value.strip() for name, value in zip(header, row) if value.strip()}
            values = {name: value if name == "shape" else float(value) for name, value in words.items()}
            cases.append(Case(**values))  # type: ignore[arg-type]
        except (TypeError, ValueError) as error:
            raise CaseError(f"{path}, line {number}: {error}") from None
    return cases


def _code(line: str, path: Path) -> Case:
    try:
        return Case.from_code(line)
    except CaseError as error:
        raise CaseError(f"{path}: {error}") from None
