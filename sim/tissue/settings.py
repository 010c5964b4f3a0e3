"""How a stroke is computed: mesh sizes, positions, tolerance, solver; and the key of a result.

Units: mm.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from numbers import Real

import numpy as np

from palpate.sim.tissue.case import Case
from palpate.sim.tissue.errors import CaseError

SOLVER_VERSION = "tissue-3"
"""Changes whenever the same case and settings would give other numbers."""

FINE_SOLVER_VERSION = "tissue-6"
"""The same for finer meshes than the default's: pressing starts higher and renews less of the tangent."""

SOLID_SOLVER_VERSION = "solid-4"
"""The same for solid lumps."""

_FAR_STEP_MM = 4.0
_SOLID_FINE_STEPS = 4

_SWITCHES = ("to_border", "all_rows", "press_only")

SOLVERS = ("auto", "strip", "cholmod", "superlu", "reference")


@dataclass(frozen=True)
class Settings:
    """Numerical settings of a stroke.

    Parameters
    ----------
    hx_mm : float
        Width of the element columns under the stroke.
    increment_mm : float
        Step between the probe's positions; columns should divide it.
    start_mm : float
        First position; the stroke ends over the lump, and with friction beyond it at `-start_mm`.
    far_start_mm : float, optional
        Where a coarser approach to `start_mm` begins, in steps of 4 mm.
    refine : int
        Divides every element size (also rows and rings) by this number, for mesh studies.
    row_mm, gland_row_mm : float
        Largest height of element rows in fat and gland.
    skin_mm : tuple of float
        Heights of the thin rows under the surface.
    shells : int
        Least number of element rings in the tissue round a lump in the plane. A lump of up to 9 mm has one
        otherwise, and a bump 1 to 2 % too high.
    layer_mm : float
        Widest layer of elements under the face, across the stroke, where the lump is solid. Those of 5.5 mm
        read cells by 1 % of the mean pressure wrong.
    to_border : bool
        Read pressures in the plane up to the border of the contact, between the skin's nodes, as over solid
        lumps always. Straight lines from node to node read the rows by the border up to a tenth wrong, at
        columns of 2 mm.
    all_rows : bool
        Keep every row of elements over a solid lump. Otherwise, as in kept sets, one is left out where the
        others need grow by no more than about a half: there the bump of a small deep lump jumps by 1 %.
    left_mm, right_mm : float
        Where the roller sides stand.
    tolerance : float
        Largest nodal force out of balance at convergence, as a fraction of the force on the probe.
    solver : str
        `auto`, `strip` (own column Cholesky), `cholmod` (needs cvxopt) or `superlu` (plain SciPy): the same
        method, the tangent factored by another library. `reference` is the weak form as scikit-fem assembles
        it (`reference.py`), some hundred times slower.
    press_only : bool
        Press at the first position and do not stroke: the press before a stroke, force by force.
    """

    hx_mm: float = 2.0
    increment_mm: float = 2.0
    start_mm: float = -28.0
    far_start_mm: float | None = None
    refine: int = 1
    row_mm: float = 3.5
    gland_row_mm: float = 5.0
    skin_mm: tuple[float, ...] = (0.35, 0.55)
    shells: int = 1
    layer_mm: float = 3.0
    to_border: bool = False
    all_rows: bool = False
    left_mm: float = -120.0
    right_mm: float = 100.0
    tolerance: float = 1e-5
    solver: str = "auto"
    press_only: bool = False

    def __post_init__(self) -> None:
        self._check_numbers()
        sizes = (self.hx_mm, self.increment_mm, self.row_mm, self.gland_row_mm, *self.skin_mm)
        if not all(s > 0 for s in sizes):
            raise CaseError("the mesh sizes and the increment must be positive numbers")
        if not 0.1 <= self.hx_mm <= 4.0:
            raise CaseError(f"hx_mm must lie between 0.1 and 4, not {self.hx_mm:g}")
        if self.increment_mm < 0.01:
            raise CaseError(f"increment_mm must be 0.01 or more, not {self.increment_mm:g}")
        if not -60.0 <= self.start_mm <= 0.0:
            raise CaseError(f"start_mm must lie between -60 and 0, not {self.start_mm:g}")
        if self.far_start_mm is not None and not -60.0 <= self.far_start_mm <= self.start_mm:
            raise CaseError("far_start_mm must lie between -60 and start_mm")
        if not 1 <= self.refine <= 64 or int(self.refine) != self.refine:
            raise CaseError(f"refine must be a whole number from 1 to 64, not {self.refine}")
        if not 1 <= self.shells <= 16 or int(self.shells) != self.shells:
            raise CaseError(f"shells must be a whole number from 1 to 16, not {self.shells}")
        if not 0.5 <= self.layer_mm <= 5.5:
            raise CaseError(f"layer_mm must lie between 0.5 and 5.5, not {self.layer_mm:g}")
        if not (-1000.0 <= self.left_mm <= -75.0 and 75.0 <= self.right_mm <= 1000.0):
            raise CaseError("the sides must stand 75 to 1000 mm from the lump")
        if not 1e-10 <= self.tolerance <= 1e-3:
            raise CaseError(f"tolerance must lie between 1e-10 and 1e-3, not {self.tolerance:g}")
        if self.solver not in SOLVERS:
            raise CaseError(f"solver must be one of {', '.join(SOLVERS)}, not {self.solver!r}")

    def _check_numbers(self) -> None:
        """CaseError unless every number is one, and finite."""
        if isinstance(self.skin_mm, str) or not isinstance(self.skin_mm, Sequence) or not self.skin_mm:
            raise CaseError(f"skin_mm must be a list of heights, not {self.skin_mm!r}")
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name in _SWITCHES and not isinstance(value, bool):
                raise CaseError(f"{field.name} must be True or False, not {value!r}")
            if field.name in ("solver", *_SWITCHES) or (field.name == "far_start_mm" and value is None):
                continue
            for number in value if field.name == "skin_mm" else (value,):
                if not isinstance(number, Real) or not math.isfinite(number):
                    raise CaseError(f"{field.name} must be a finite number, not {number!r}")

    def positions_mm(self, friction: bool = False) -> np.ndarray:
        """The probe's positions, shape (n,): to the lump's middle, with friction to the other side."""
        if self.press_only:
            return np.array([self.start_mm])
        n = round(-self.start_mm / self.increment_mm)
        if abs(n * self.increment_mm + self.start_mm) > 1e-9:
            raise CaseError("start_mm must be a whole number of increments from the lump")
        half = self.start_mm + self.increment_mm * np.arange(n + 1)
        if self.far_start_mm is not None:
            half = np.concatenate([np.arange(self.far_start_mm, self.start_mm - 1e-9, _FAR_STEP_MM), half])
        return np.concatenate([half, -half[-2::-1]]) if friction else half

    def solid_positions_mm(self) -> np.ndarray:
        """Positions over a solid lump, (n,): every increment in the last four, every other one before them.

        What lies between follows from a cubic spline, mirrored beyond the lump: within .1 % of amplitude
        and width.
        """
        whole = self.positions_mm()
        fine = whole > -(_SOLID_FINE_STEPS + 0.5) * self.increment_mm
        coarse = whole[~fine][::-1][1::2][::-1]
        if (~fine).sum() % 2:
            coarse = np.append(whole[:1], coarse)
        return np.concatenate([coarse, whole[fine]])

    @property
    def fine(self) -> bool:
        """Columns narrower than the default's."""
        return self.hx_mm / self.refine < Settings.hx_mm

    def refined(self, factor: int) -> Settings:
        """The same with every element `factor` times smaller."""
        return replace(self, refine=self.refine * factor)


def case_key(case: Case, settings: Settings) -> str:
    """Hash that names a result: of the case, the settings and the solver's version; 32 hex digits."""
    plane = FINE_SOLVER_VERSION if settings.fine else SOLVER_VERSION
    version = SOLID_SOLVER_VERSION if case.solid else plane
    numerics = asdict(settings)
    for name in (*_SWITCHES, "shells", "layer_mm"):
        if numerics[name] == getattr(Settings, name):
            del numerics[name]  # as keys were before there was one
    record = {"case": case.to_dict(), "settings": numerics, "solver": version}
    text = json.dumps(record, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:32]
