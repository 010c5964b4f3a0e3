"""Strokes that the pipeline refuses, and how often the intervals would hold if it did not.

    python -m tests.benchmarks refused

Few frames, a force that rises along the stroke, an end too soon past the lump: at typical noise, over lumps
that the bundled model has never met.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from unittest import mock

import numpy as np

from firmware_py.calib import Calibration
from palpate import models
from palpate.console import table
from palpate.dataset.answers import shows_lump
from palpate.features.map_features import Floats
from palpate.firmware_twin.replay_core import compiled
from palpate.learn.design import lump_cases
from palpate.learn.lumps import read_lumps
from palpate.learn.observed import Observed, of_streams
from palpate.model_export.integers import force_map as force_maps
from palpate.sim.probe.noise import LEVELS
from palpate.sim.probe.packed_frames import FrameStream
from palpate.sim.probe.sensors import SensorModel, StrokeField
from palpate.sim.tissue import sweep
from palpate.sim.tissue.any_tissue import FORCE_PARTS, STROKES, at_forces
from palpate.wire.events import OUTPUTS
from tests.studies.coverage import SEED, held

LUMPS = 160
TYPICAL = LEVELS["typical"].with_(start_mm=0.0)


class RisingForce(SensorModel):
    """A hand whose force rises evenly along the stroke, by `rise` of its mean to either side."""

    rise = 0.0

    def force_at(self, stroke_mm: Floats) -> Floats:
        """N/m, at places along the stroke."""
        share = 2 * np.asarray(stroke_mm, float) / self.travel_mm
        return np.asarray(self.mean_force_N_per_m * (1 + self.rise * share))


def strokes(
    fields: list[StrokeField], frames: int = 50, rise: float = 0.1, past_mm: float = 40.0
) -> list[tuple[FrameStream, Calibration]]:
    """One stroke over each lump, from 40 mm before it to `past_mm` past it, with the probe's calibration."""
    out = []
    for k, field in enumerate(fields):
        model = RisingForce(field, TYPICAL, SEED + k)
        model.rise = rise
        stream = model.stroke(frames)
        x = np.linspace(-40.0, 40.0, frames)
        n = int(np.sum(x <= past_mm))
        cut = replace(
            stream,
            packed=stream.packed[:n],
            positions_um=stream.positions_um[:n],
            displacements_um=stream.displacements_um[:n],
            truth=model.truth(x[:n]),
        )
        out.append((cut, model.calibration()))
    return out


def observed(made: list[tuple[FrameStream, Calibration]], force_map: bytes | None) -> Observed:
    """The strokes through the firmware's pipeline."""
    return of_streams(made, range(len(made)), force_map)


@contextmanager
def nothing_refused() -> Iterator[None]:
    """The pipeline without its rules."""
    chain = compiled().feature_chain
    with ExitStack() as stack:
        stack.enter_context(mock.patch.object(chain, "GAP_UM", 1 << 29))
        for rule in ("_uneven", "_clear"):
            stack.enter_context(mock.patch.object(chain.Chain, rule, return_value=False))
        yield


SETTINGS = (
    ("50 frames in 80 mm, force even to 10 %, ends 40 mm past the lump", {}),
    *((f"{n} frames", {"frames": n}) for n in (30, 25, 20, 16)),
    *((f"force rises by {100 * r:.0f} % to either side", {"rise": r}) for r in (0.2, 0.3, 0.4)),
    *((f"ends {mm} mm past the lump", {"past_mm": mm}) for mm in (28, 24, 20, 15)),
)


def main() -> None:
    spec = models.load(models.TOLD)
    blob = None if spec.force_map is None else force_maps.blob(spec.force_map)
    with tempfile.TemporaryDirectory() as folder:
        sweep(at_forces(lump_cases(LUMPS, SEED, {}), FORCE_PARTS), STROKES, Path(folder))
        fields = [lump.field for lump in read_lumps(Path(folder))[0]]
    rows = []
    for words, setting in SETTINGS:
        made = strokes(fields, **setting)
        with nothing_refused():
            seen = observed(made, blob)
        found = seen.take(seen.whole & shows_lump(spec, seen.X))
        shares = held(spec, found)
        refused = 1 - observed(made, blob).whole.mean()
        covered = [f"{100 * shares[name].mean():.0f}" for name in OUTPUTS]
        rows.append([words, f"{100 * refused:.0f}", str(len(found)), *covered])
    print("Coverage of the 90 % intervals without the rules, %, of strokes that show a lump:")
    table(["stroke", "refused, %", "n", *OUTPUTS], rows)
