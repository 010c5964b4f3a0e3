"""The stroke over a solid lump, as others call it. Units: mm, kPa, N."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue import face_sensors
from palpate.sim.tissue.case import Case
from palpate.sim.tissue.errors import FoldedElement
from palpate.sim.tissue.one_thread import one_blas_thread
from palpate.sim.tissue.settings import Settings
from palpate.sim.tissue.solid.grid import lay_grid
from palpate.sim.tissue.solid.plain import PlainPress
from palpate.sim.tissue.solid.result import SolidStroke
from palpate.sim.tissue.solid.run import SolidGeometry, SolidRun, Track, set_up
from palpate.sim.tissue.state import State
from palpate.sim.tissue.stroke import checked_positions

Floats = NDArray[np.float64]

RAMP = (0.25, 0.5)
"""Parts of the lowest force at which a press-in ramp takes images."""

Visit = Callable[[SolidRun, float, list[State]], None]

_local = threading.local()


def simulate_forces(
    case: Case,
    forces: Sequence[float],
    settings: Settings | None = None,
    positions_mm: Sequence[float] | None = None,
    ramp: bool = False,
    visit: Visit | None = None,
) -> list[SolidStroke]:
    """One stroke for each force of `forces` (units of 100 N/m times 39 mm), all along one way.

    Where a factor has been found for the first force the others use it too: each further stroke costs a
    fraction of the first.

    Parameters
    ----------
    ramp : bool
        Also take images at `RAMP` parts of the lowest force while pressing in.
    visit : callable, optional
        Called with the run, the position and the states there, by rising force; at the first position the
        ramp's come before them.

    Raises
    ------
    CaseError, StrokeError
        As `simulate`.
    """
    settings = settings or Settings()
    wanted = settings.solid_positions_mm() if positions_mm is None else positions_mm
    positions = checked_positions(wanted)
    with one_blas_thread():
        _warm_up()
        began = time.thread_time()
        order = np.argsort(forces, kind="stable")
        rising = [float(forces[i]) for i in order]
        geometry = _geometry_of(case, settings, float(positions[0]), float(positions[-1]))
        run = SolidRun(case, settings, geometry, 0.5 if geometry.mesh.grid.half else 1.0, positions)
        strokes = _Stroking(case, settings, geometry, run, positions).strokes(rising, ramp, began, visit)
    places = np.argsort(order)
    return [strokes[i] for i in places]


class _Stroking:
    """All strokes of one case, at several forces."""

    def __init__(
        self, case: Case, settings: Settings, geometry: SolidGeometry, run: SolidRun, positions: Floats
    ) -> None:
        self.case, self.run, self.positions = case, run, positions
        self.settings, self.geometry = settings, geometry
        self.nodes = len(geometry.mesh.nodes_mm)

    def strokes(
        self, forces: Sequence[float], ramp: bool, began: float, visit: Visit | None = None
    ) -> list[SolidStroke]:
        """One for each of the rising forces."""
        first = float(self.positions[0])
        wanted = [*(part * forces[0] for part in RAMP if ramp), *forces]
        states = self._pressed(wanted, first)
        pressed = list(zip(wanted, states))[: -len(forces)]
        tracks = [Track(self.run.force(F), first, state) for F, state in zip(forces, states[-len(forces) :])]
        rows, iterations = [], []
        before = 0
        for i, position in enumerate(map(float, self.positions)):
            if i:
                self.run.slide(tracks, position)
            if visit is not None:
                visit(self.run, position, [t.recent[-1][1] for t in tracks] if i else states)
            rows.append([self.run.read(t.recent[-1][1], position, t.force) for t in tracks])
            iterations.append(self.run.newton.counts.iterations - before)
            before = self.run.newton.counts.iterations
        spent = (time.thread_time() - began) / len(forces)
        read = [self.run.read(state, first, self.run.force(F_rel)) for F_rel, state in pressed]
        images = np.array([row["images_kPa"] for row in read]).reshape(
            -1, face_sensors.ALONG, face_sensors.ACROSS
        )
        return [
            SolidStroke(
                case=replace(self.case, F_rel=F_rel),
                positions_mm=self.positions,
                **_columns([row[k] for row in rows]),
                iterations=np.array(iterations) // len(forces),
                factorisations=self.run.newton.counts.factorisations,
                nodes=self.nodes,
                cpu_s=spent,
                ramp_N=np.array([replace(self.case, F_rel=part).F_N for part, _ in pressed]),
                ramp_displacement_mm=np.array([row["displacement_mm"] for row in read]),
                ramp_images_kPa=images,
            )
            for k, F_rel in enumerate(forces)
        ]

    def _pressed(self, forces: Sequence[float], position: float) -> list[State]:
        """The states at the first position under rising forces."""
        # All guesses first: the plain tissue's factor is gone before the lump's takes its memory.
        plain = PlainPress(self.case, self.settings, self.geometry)
        guesses = [plain.state(F_rel, position) for F_rel in forces]
        del plain
        return [
            self.run.press(position, self.run.force(F_rel), guess) for F_rel, guess in zip(forces, guesses)
        ]


def _columns(rows: list[dict[str, Any]]) -> dict[str, Floats]:
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def _geometry_of(case: Case, settings: Settings, first: float, last: float) -> SolidGeometry:
    """The geometry of a case; the last one is remembered per thread: stiffness and force do not change it."""
    shape = (case.half_axes_mm, case.offset_mm, case.depth_mm, case.borders_mm, case.reach_mm)
    key = (shape, settings, first, last)
    if _local.__dict__.get("key") != key:
        _local.__dict__.clear()
        try:
            _local.geometry = set_up(lay_grid(case, settings, first, last))
        except FoldedElement:  # a wide lump whose border to the gland lies near its top or bottom
            _local.geometry = set_up(lay_grid(case, settings, first, last, follow_border=False))
        _local.key = key
    geometry: SolidGeometry = _local.geometry
    return geometry


def forget_geometry() -> None:
    """Forget what this thread has set up, to time a stroke from nothing."""
    _local.__dict__.clear()


@cache
def _warm_up() -> None:
    """Compile the kernels, or load them, so that no stroke's time has this in it."""
    case, settings = Case.from_code("d10h08e10f05_ball"), Settings(hx_mm=4.0, layer_mm=5.5)
    positions = np.array([-4.0, 0.0])
    geometry = set_up(lay_grid(case, settings, -4.0, 0.0))
    run = SolidRun(case, settings, geometry, 0.5, positions)
    _Stroking(case, settings, geometry, run, positions).strokes([case.F_rel], False, 0.0)
