"""The stroke, as others call it. Units: mm, kPa, N/m."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue.case import Case
from palpate.sim.tissue.errors import CaseError
from palpate.sim.tissue.geometry import forget_geometries, geometry_of
from palpate.sim.tissue.one_thread import one_blas_thread
from palpate.sim.tissue.result import Stroke
from palpate.sim.tissue.run import StrokeRun
from palpate.sim.tissue.settings import Settings
from palpate.sim.tissue.state import State

_log = logging.getLogger(__name__)

Floats = NDArray[np.float64]


Visit = Callable[[StrokeRun, float, State], None]
"""Told of every position of a stroke, with the equilibrium there."""


def simulate(
    case: Case,
    settings: Settings | None = None,
    positions_mm: Sequence[float] | None = None,
    visit: Visit | None = None,
) -> Stroke:
    """Simulate one stroke.

    Parameters
    ----------
    case : Case
        Lump, tissue, probe and force.
    settings : Settings, optional
        How finely.
    positions_mm : sequence of float, optional
        The probe's positions, ascending, in place of the settings'.
    visit : callable, optional
        Called with the run, the position and the state at each position.

    Returns
    -------
    Stroke
        For a ball or an ellipsoid a `SolidStroke`, whose images are those of the whole face.

    Raises
    ------
    CaseError
        The case or the positions make no sense.
    StrokeError
        There is no equilibrium at some position.
    """
    return simulate_forces(case, [case.F_rel], settings, positions_mm, visit)[0]


def simulate_forces(
    case: Case,
    forces: Sequence[float],
    settings: Settings | None = None,
    positions_mm: Sequence[float] | None = None,
    visit: Visit | None = None,
) -> list[Stroke]:
    """Load, stroke, load more, stroke again: one stroke for each force of `forces` (units of 100 N/m).

    The geometry's set-up is shared and each load starts from the one before; otherwise as `simulate`.
    """
    if case.solid:
        from palpate.sim.tissue.solid.stroke import simulate_forces as solid_strokes

        if visit is not None:
            raise CaseError(f"{case.code}: only cylinders' strokes are visited here")
        return list(solid_strokes(case, forces, settings, positions_mm))
    settings = settings or Settings()
    positions = checked_positions(
        settings.positions_mm(case.friction > 0) if positions_mm is None else positions_mm
    )
    strokes = []
    pressed: State | None = None
    with one_blas_thread():
        _warm_up()
        began = time.thread_time()
        geometry = geometry_of(case, settings, float(positions[0]), float(positions[-1]))
        for force in forces:
            loaded = replace(case, F_rel=force)
            run = StrokeRun(loaded, settings, geometry)
            pressed = run.press(positions[0], pressed)
            strokes.append(run.stroke(positions, pressed, began, visit))
            took_s = time.thread_time() - began
            _log.info("%s: %d positions in %.1f s of CPU time", loaded.code, len(positions), took_s)
            began = time.thread_time()
    return strokes


@cache
def _warm_up() -> None:
    """Compile the kernels, or load them, so that no stroke's time has this in it."""
    case = Case.from_code("d10h08eNLf01")
    run = StrokeRun(case, Settings(), geometry_of(case, Settings(hx_mm=4.0), 0.0, 2.0))
    run.stroke(np.array([0.0, 2.0]), run.press(0.0, None), 0.0)
    forget_geometries()


def load_curve(
    case: Case, forces: Sequence[float], position_mm: float = 0.0, settings: Settings | None = None
) -> list[Stroke]:
    """Press harder and harder at one position: strokes of a single position, one per force."""
    return simulate_forces(case, forces, settings, [position_mm])


def checked_positions(positions: Sequence[float] | Floats) -> Floats:
    """Positions (n,) in mm as an array; CaseError unless they ascend and lie within 60 mm of the lump."""
    out = np.asarray(positions, float)
    if out.ndim != 1 or not len(out) or not np.isfinite(out).all() or (np.diff(out) <= 0).any():
        raise CaseError("positions_mm must be a non-empty ascending list of numbers")
    if out[0] < -60.0 or out[-1] > 60.0:
        raise CaseError("positions_mm must lie between -60 and 60")
    return out
