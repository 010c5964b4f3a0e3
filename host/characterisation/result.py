"""A characterised sensor: its numbers, the noise that follows, and sensor.toml."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from palpate.characterisation import quantities
from palpate.characterisation.campaign import Measured
from palpate.characterisation.quantities import Cells, Quantity
from palpate.errors import UsageError
from palpate.files import whole_file
from palpate.sim.probe.noise import Noise

BY_SIZE = ("common_gain", "position_scale")
"""Of one sensor only the error itself is measured; as a spread its size counts."""


@dataclass(frozen=True)
class Sensor:
    """What was measured.

    Attributes
    ----------
    numbers : dict of Quantity
        By the fields of `sim.probe.noise.Noise`.
    cells : Cells
    """

    numbers: dict[str, Quantity]
    cells: Cells

    @property
    def noise(self) -> Noise:
        """As training and emulation take it; what was not measured is 0."""
        values = {name: max(q.value, 0.0) for name, q in self.numbers.items()}
        values |= {name: abs(self.numbers[name].value) for name in BY_SIZE if name in self.numbers}
        return Noise().with_(dead=float((~self.cells.live).mean()), **values)

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "noise": asdict(self.noise),
            "measured": {name: asdict(q) for name, q in self.numbers.items()},
            "dead": np.argwhere(self.cells.dead).tolist(),
            "stuck": np.argwhere(self.cells.stuck).tolist(),
        }

    def save(self, path: Path) -> None:
        """Write sensor.toml: [noise], and beside it what was measured with its interval."""
        noise = asdict(self.noise)
        lines = [
            "# What `palpate characterise` measured. [noise] is what training and emulation take.",
            "",
            "[noise]",
        ]
        lines += [f"{name} = {_toml(noise[name])}" for name in noise if name != "quantise"]
        lines += ["", "[cells]", f"dead = {np.argwhere(self.cells.dead).tolist()}"]
        lines += [f"stuck = {np.argwhere(self.cells.stuck).tolist()}"]
        for name, q in self.numbers.items():
            low, high = (_toml(v) for v in (q.low, q.high))
            lines += ["", f"[measured.{name}]", f"value = {_toml(q.value)}", f"interval = [{low}, {high}]"]
            lines += [f'of = "{q.of}"']
        with whole_file(path) as part:
            part.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _toml(value: float) -> str:
    text = f"{value:.6g}"
    return text if any(c in text for c in ".einf") else text + ".0"


def characterise(found: list[Measured]) -> Sensor:
    """Everything that a campaign's recordings tell of a sensor.

    Raises
    ------
    UsageError
        All cells are dead.
    """
    cells = quantities.cells_of(found)
    if cells.live.sum() < 2:
        raise UsageError("fewer than two cells are alive in these recordings")
    numbers = quantities.in_air(found, cells.live)
    white = numbers["white"].value if "white" in numbers else 0.0
    numbers |= quantities.under_a_cuff(found, cells.live, white)
    numbers |= quantities.over_plain_tissue(found, cells.live)
    order = [f.name for f in fields(Noise)]
    return Sensor({name: numbers[name] for name in order if name in numbers}, cells)
