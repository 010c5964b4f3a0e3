"""Strokes over solid lumps to be inverted: computed on a mesh that the inversion does not use, at positions
and forces of their own, and felt by an emulated probe's sensors.

Between them follow a cubic spline over the places and a parabola in the force (`StrokeField`): every frame
at its own place and force would take the solver an hour a stroke.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from palpate.inversion.felt import FeltStroke
from palpate.inversion.start import Start
from palpate.sim.probe.noise import level_named
from palpate.sim.probe.packed_frames import FrameStream
from palpate.sim.probe.sensors import PRESS_FRAMES, SensorModel
from palpate.sim.probe.stroke_field import StrokeField
from palpate.sim.tissue import Case, Settings, Stroke
from palpate.sim.tissue.any_tissue import FORCE_PARTS
from palpate.sim.tissue.solid.press import felt
from palpate.sim.tissue.solid.stroke import simulate_forces
from tests.host.inversion.world import of_probe, of_stream

WORLD = Settings(hx_mm=1.4, layer_mm=2.2, all_rows=True)
PLACES_MM = (-34.0, -28.0, -23.0, -18.0, -14.0, -11.0, -8.0, -6.0, -4.0, -2.0, 0.0)
PRESS_PARTS = (0.17, 0.26, 0.38, 0.55, 0.8, 1.15)
"""Of the middle force, at which the press before the stroke is computed."""


def strokes_over(case: Case, settings: Settings = WORLD) -> tuple[list[Stroke], list[Stroke]]:
    """Strokes over a lump at three forces about its own, and the press where they begin."""
    forces = [case.F_rel * part for part in FORCE_PARTS]
    strokes: list[Stroke] = list(simulate_forces(case, forces, settings, PLACES_MM))
    presses: list[Stroke] = list(
        simulate_forces(case, [case.F_rel * part for part in PRESS_PARTS], settings, PLACES_MM[:1])
    )
    at = strokes[0].positions_mm[:1]
    return strokes, [felt(one.case, at, one.displacement_mm[:1], one.images_kPa[:1]) for one in presses]


def kept_strokes(path: Path, case: Case) -> tuple[list[Stroke], list[Stroke]]:
    """The same, read from `path` where they were computed before."""
    forces = [part * case.F_rel for part in (*FORCE_PARTS, *PRESS_PARTS)]
    if not path.exists():
        strokes, press = strokes_over(case)
        arrays = {
            f"{name}{k}": np.asarray(getattr(one, name))
            for k, one in enumerate([*strokes, *press])
            for name in ("positions_mm", "displacement_mm", "images_kPa")
        }
        np.savez_compressed(path, **arrays)
    with np.load(path) as found:
        all_of = [
            felt(
                replace(case, F_rel=force),
                *(found[f"{name}{k}"] for name in ("positions_mm", "displacement_mm", "images_kPa")),
            )
            for k, force in enumerate(forces)
        ]
    return all_of[: len(FORCE_PARTS)], all_of[len(FORCE_PARTS) :]


def felt_over(
    strokes: Sequence[Stroke], press: Sequence[Stroke], seed: int, noise: str = "typical",
    probe: int | None = None,
) -> tuple[FeltStroke, Start, FrameStream]:  # fmt: skip
    """One stroke by a probe and a hand of this seed, or by the probe of another."""
    field = StrokeField(*strokes)
    sensors = SensorModel(field, level_named(noise), seed)
    if probe is not None:
        of_probe(sensors, SensorModel(field, level_named(noise), probe))
    stream = sensors.stroke(press=PRESS_FRAMES, pressed=StrokeField(*press))
    found, start = of_stream(stream, sensors.calibration())
    return found, start, stream
