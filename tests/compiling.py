"""Compiles what the tests run compiled, for this machine: `make test` does it beside lint.

    python -m tests.compiling

Else three workers would begin with the same minute's work. The plane solver comes first, for most need it.
Where everything is compiled already this takes seconds.
"""

from __future__ import annotations

import numpy as np

from palpate.firmware_twin.replay_core import Replay
from palpate.sim.probe.sensors import LEVELS, SensorModel, StrokeField
from palpate.sim.tissue import Case, Settings, simulate
from palpate.sim.tissue.derivatives import differentiate
from palpate.sim.tissue.frames import solve_frames
from palpate.sim.tissue.topology import Topology
from tests.firmware_py.strokes import read_strokes


def main() -> None:
    """One stroke through each of the three, and derivatives, which have a precision of their own."""
    case = Case.from_code("d12h07e20f09")
    simulate(case, Settings(start_mm=-4.0))
    topology, place, force = Topology(case, Settings(), -1.0, 1.0), np.zeros(1), np.array([case.F_N_per_m])
    differentiate(solve_frames(case, Settings(), topology.geometry(case), place, force), topology)
    model = SensorModel(StrokeField(*read_strokes()[0]), LEVELS["typical"], 1, across_mm=3.9)
    Replay().stream(model.stroke(60), model.calibration())
    simulate(Case.from_code("d10h06e10f08_ball"), Settings(hx_mm=4.0), [0.0])


if __name__ == "__main__":
    main()
