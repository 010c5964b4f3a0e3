"""What the sensors of a probe read while a hand presses and strokes it over a lump, or beside it.

The lump is simulated at several forces around its case's own, so that the hand can wander. `palpate refine`
finds in the frames what no model of tissue has, so the mesh is fine and the press has many forces.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from firmware_py import geometry
from palpate.sim.probe.noise import level_named
from palpate.sim.probe.sensors import FORCE_RATIO, PRESS_FRAMES, FrameStream, SensorModel, StrokeField
from palpate.sim.tissue import Case, simulate_forces
from palpate.sim.tissue.any_tissue import PRESSES, REFERENCE_PARTS, STROKES, without_its_lump
from palpate.wire.cells import SHAPE

if TYPE_CHECKING:
    from firmware_py.calib import Calibration

BESIDE_MM = 35.0
"""From the lump to the reference press."""
FIRST_MM = -28.0
_PRESSED = tuple(np.geomspace(0.15, 1.4, 30))
"""Forces of a press, over the middle one: between fewer, rows where the contact ends bend."""


def strokes_over(
    case: Case | str,
    noise: str = "typical",
    seed: int = 1,
    frames: int = 50,
    strokes: int = 1,
    steady: bool = False,
    still: bool = False,
    press: bool = True,
) -> tuple[list[FrameStream], Calibration]:
    """What a probe's sensors read of some strokes over one lump, and the calibration it left the bench with.

    Parameters
    ----------
    case : Case or str
        The lump, or its code. A solid one takes a quarter of a minute to simulate, beside the line a whole.
    noise : str
        A level of `palpate.sim.probe.noise.LEVELS`, or a file as sensor.toml.
    seed : int
        Of the first stroke; each further one has the next.
    frames, strokes : int
        Frames per stroke, and strokes.
    steady : bool
        The hand's force does not wander.
    still : bool
        There is no hand: frames of a probe lying in the air.
    press : bool
        The hand presses before it strokes, in `PRESS_FRAMES` frames more.
    """
    case = _case(case)
    forces = [case.F_rel * FORCE_RATIO**part for part in (-0.5, 0.0, 0.5)]
    ramped = _solid(case, forces, ramp=True) if case.solid else []
    field = StrokeField(*(ramped or simulate_forces(case, forces, STROKES)))
    level = level_named(noise)
    if steady:
        level = level.without("force")
    probes = [SensorModel(field, level, seed + k, mean_force_N_per_m=case.F_N_per_m) for k in range(strokes)]
    calibration = probes[0].calibration()
    # One emulated probe stands for all of them: it knows the dead cells of each.
    calibration.set_dead([int(cell) for probe in probes for cell in np.flatnonzero(probe.known_dead)])
    if still:
        return [probe.untouched(frames) for probe in probes], calibration
    if not press:
        return [probe.stroke(frames) for probe in probes], calibration
    if ramped:
        from palpate.sim.tissue.solid.press import press_before

        pressed = StrokeField(*press_before(ramped))
    else:
        pressed = _pressed(case, PRESSES.start_mm)
    return [probe.stroke(frames, press=PRESS_FRAMES, pressed=pressed) for probe in probes], calibration


def reference_beside(case: Case | str, noise: str, seed: int, steady: bool = False) -> FrameStream:
    """A press 35 mm beside the lump, by the probe and the hand of `strokes_over`."""
    case, level = _case(case), level_named(noise)
    if case.solid:  # where a stroke begins, as far beside the lump as the mesh goes
        pressed = _pressed(case, FIRST_MM)
    else:
        pressed = _pressed(without_its_lump(case), PRESSES.start_mm)
    hand = SensorModel(pressed, level.without("force") if steady else level, seed)
    return hand.reference(pressed, case.F_N_per_m, place_mm=BESIDE_MM)


def presses_over(
    case: Case | str, noise: str, seed: int, presses: int = 1, beside_mm: float = 0.0
) -> list[FrameStream]:
    """Presses without a stroke, each from the air to the case's force and back, so far beside the lump."""
    case, level = _case(case), level_named(noise)
    pressed = _pressed(case, -abs(beside_mm))
    probes = [SensorModel(pressed, level, seed + k) for k in range(presses)]
    return [probe.reference(pressed, case.F_N_per_m, place_mm=beside_mm) for probe in probes]


def cuffed(case: Case | str, noise: str, seed: int, pressure_kPa: float, frames: int) -> Any:
    """What the same cells read under a cuff: counts (frames, cells), of 0 kPa in the air."""
    sensors = SensorModel(_pressed(_case(case), 0.0), level_named(noise), seed)
    even = np.full((frames, *SHAPE), pressure_kPa)
    counts, _, _ = sensors.felt(even, np.zeros(frames), np.arange(0.0, 2.0 * frames, 2.0), np.zeros(frames))
    return np.clip(np.rint(counts), 0, geometry.FULL_COUNT)


def _case(case: Case | str) -> Case:
    return Case.from_code(case) if isinstance(case, str) else case


def _pressed(case: Case, at_mm: float) -> StrokeField:
    """What is under the probe there, at rising forces."""
    forces = [case.F_rel * part for part in (REFERENCE_PARTS if case.solid else _PRESSED)]
    if case.solid:
        return StrokeField(*_solid(case, forces, positions_mm=(at_mm,)))
    return StrokeField(*simulate_forces(case, forces, replace(PRESSES, start_mm=at_mm)))


def _solid(case: Case, forces: list[float], **how: Any) -> list[Any]:
    from palpate.sim.tissue.solid.stroke import simulate_forces as simulate_solid

    return list(simulate_solid(case, forces, **how))
