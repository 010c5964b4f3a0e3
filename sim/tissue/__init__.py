"""The tissue under a stroke: contact finite elements, in plane strain as the thesis has it or in space.

    from palpate.sim.tissue import Case, simulate
    stroke = simulate(Case.from_code("d10h08e10f10"))
    stroke.displacement_mm, stroke.images_kPa

Importing this package is cheap: compiled kernels load at the first stroke.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from palpate.sim.tissue.case import FORCE_UNIT_N_PER_M, LIKE_FAT, Case
from palpate.sim.tissue.errors import CaseError, StrokeError, TissueError
from palpate.sim.tissue.thesis_runs import THESIS_CODES

if TYPE_CHECKING:
    from palpate.sim.tissue.design import WIDEST, Ranges, one_factor_cases, read_design, sobol_cases
    from palpate.sim.tissue.face_sensors import SENSORS_MM
    from palpate.sim.tissue.fields import Fields, simulate_fields
    from palpate.sim.tissue.result import Stroke
    from palpate.sim.tissue.settings import SOLVER_VERSION, Settings, case_key
    from palpate.sim.tissue.solid.result import SolidStroke
    from palpate.sim.tissue.stroke import load_curve, simulate, simulate_forces
    from palpate.sim.tissue.sweeps import Progress, sweep
    from palpate.sim.tissue.tables import check_finished, iterate_strokes, load_strokes, read_table

_HOMES = {
    "SENSORS_MM": "face_sensors",
    "SolidStroke": "solid.result",
    "Stroke": "result",
    "SOLVER_VERSION": "settings",
    "Settings": "settings",
    "case_key": "settings",
    "load_curve": "stroke",
    "Fields": "fields",
    "simulate": "stroke",
    "simulate_fields": "fields",
    "simulate_forces": "stroke",
    "Ranges": "design",
    "WIDEST": "design",
    "one_factor_cases": "design",
    "read_design": "design",
    "sobol_cases": "design",
    "Progress": "sweeps",
    "check_finished": "tables",
    "iterate_strokes": "tables",
    "load_strokes": "tables",
    "read_table": "tables",
    "sweep": "sweeps",
}

__all__ = [
    "FORCE_UNIT_N_PER_M",
    "LIKE_FAT",
    "SENSORS_MM",
    "SOLVER_VERSION",
    "THESIS_CODES",
    "WIDEST",
    "Case",
    "CaseError",
    "Fields",
    "Progress",
    "Ranges",
    "Settings",
    "SolidStroke",
    "Stroke",
    "StrokeError",
    "TissueError",
    "case_key",
    "check_finished",
    "iterate_strokes",
    "load_curve",
    "load_strokes",
    "one_factor_cases",
    "read_design",
    "read_table",
    "simulate",
    "simulate_fields",
    "simulate_forces",
    "sobol_cases",
    "sweep",
]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f"palpate.sim.tissue.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
