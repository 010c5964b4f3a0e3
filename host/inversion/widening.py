"""From Laplace's normal posterior to intervals that hold. Units: the unknown's own, mostly logarithms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

NORMAL = 1.645
"""Half a normal 90 % interval, in standard deviations."""


@dataclass(frozen=True)
class Widening:
    """How Laplace's standard deviation becomes half an interval of `answer.fitted.LEVEL`.

    Attributes
    ----------
    settled, restless : float
        Factors where the search came to rest, and where it did not.
    floor : float
        What mesh and model leave however clear a stroke is, in the unknown's own units.
    """

    settled: float
    restless: float
    floor: float

    def half(self, sd: float, settled: bool) -> float:
        """Half an interval."""
        return float(np.hypot(NORMAL * (self.settled if settled else self.restless) * sd, self.floor))

    def sd(self, half: float, settled: bool) -> float:
        """Laplace's standard deviation of half an interval."""
        spread = np.sqrt(max(half**2 - self.floor**2, 0.0))
        return float(spread / (NORMAL * (self.settled if settled else self.restless)))


WIDER = {
    "ln d": Widening(1.25, 1.4, 0.01),
    "ln depth": Widening(1.05, 1.6, 0.02),
    "ln t": Widening(1.1, 1.8, 0.02),
    "E^-2/3": Widening(1.4, 2.0, 0.01),
    "ln_E": Widening(1.25, 1.25, 0.01),
    "apart": Widening(1.3, 3.3, 0.3),
}
"""By unknown; docs/inversion.md says how they are known."""

WIDER_PRESS = {
    "ln d": Widening(1.3, 1.5, 0.018),
    "ln depth": Widening(1.25, 1.9, 0.028),
    "ln t": Widening(1.9, 4.0, 0.025),
    "E^-2/3": Widening(1.75, 2.2, 0.015),
    "ln_E": Widening(0.8, 1.3, 0.057),
}
"""The same of a press alone."""

WIDER_SOLID = {
    "ln d": Widening(1.45, 2.5, 0.0),
    "ln width": Widening(1.15, 1.5, 0.0),
    "ln depth": Widening(1.3, 2.0, 0.0),
    "ln t": Widening(2.1, 3.0, 0.0),
    "E^-2/3": Widening(1.25, 1.5, 0.0),
    "ln_E": Widening(1.15, 1.15, 0.0),
}
"""The same over solid lumps, where `solid_modes` has widened the spread already."""

WIDER_PLAIN = {"ln t": Widening(4.0, 4.0, 0.0), "ln_E": WIDER_SOLID["ln_E"]}
"""Over tissue without a lump, where a thick fat over a gland as soft feels like a thin one over a stiffer."""
