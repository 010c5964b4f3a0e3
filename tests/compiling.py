"""Compiles what the tests run compiled, for this machine: `make test` does it beside lint.

    python -m tests.compiling

Else three workers would begin with the same minute's work. The plane solver comes first, for most need it.
Where everything is compiled already this takes seconds.
"""

from __future__ import annotations

from palpate.firmware_twin.replay_core import Replay
from palpate.sim.probe.sensors import LEVELS, SensorModel, StrokeField
from palpate.sim.tissue import Case, Settings, simulate
from tests.firmware_py.strokes import read_strokes


def main() -> None:
    """One stroke through each of the three."""
    simulate(Case.from_code("d12h07e20f09"), Settings(start_mm=-4.0))
    model = SensorModel(StrokeField(*read_strokes()[0]), LEVELS["typical"], 1, across_mm=3.9)
    Replay().stream(model.stroke(60), model.calibration())
    simulate(Case.from_code("d10h06e10f08_ball"), Settings(hx_mm=4.0), [0.0])


if __name__ == "__main__":
    main()
