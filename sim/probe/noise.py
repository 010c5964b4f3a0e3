"""Everything that stands between the skin and the count, and named levels of it. Units: mm, kPa."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from palpate.errors import UsageError
from palpate.files import read_toml

WAVE_MM = 40.0
"""Length of the undulation of the tissue's thickness."""

_BELOW_1 = ("dead", "stuck", "force", "undulation")


@dataclass(frozen=True)
class Noise:
    """Everything between the skin and the count; sensor errors are fractions of full scale or of the reading.

    Attributes
    ----------
    white, offset, drift : float
        Of full scale, standard deviations: of each reading, of each cell's zero since calibration, of the
        common zero (at the start, and twice that more by the end).
    gain, row_gain, common_gain : float
        Of the reading: spread of the cells, of whole rows, and from probe to probe of all cells together.
    dead, dead_unknown : float
        Share of dead cells; share of these that the calibration does not know.
    displacement_noise_mm, displacement_zero_mm, displacement_drift_mm : float
        White noise, zero error, and linear drift (half its range) of the displacement.
    position_mm, position_scale : float
        White noise of the encoder's reading, and its scale error.
    force : float
        Greatest departure of the hand's force from its mean, as a fraction, wandering slowly.
    creep : float
        Half of the part of each reading that lags by .3 s (18 mm at 60 mm/s).
    hysteresis : float
        Greatest excess of a reading while a cell is unloaded over that while it is loaded, of the greatest
        pressure that it has felt since the stroke began.
    stuck : float
        Share of cells that hang since the calibration: half at their zero, half anywhere.
    modulus : float
        Spread of the tissue's stiffness, all layers alike, about what the model was told. Over a stroke that
        was simulated at one force the hand's goes with it.
    undulation : float
        How far the tissue's thickness swings along the stroke, as a fraction, over `WAVE_MM`. What it does
        is worked out as a change of stiffness: thicker and softer tissue feel very nearly alike
        (docs/accuracy.md). That the surface tilts is left out.
    start_mm : float
        The lump lies up to so far from the middle of the stroke.
    quantise : bool
        Whether an ADC is there at all; False keeps the frames' counts in float64 for reference.
    """

    white: float = 0.0
    offset: float = 0.0
    drift: float = 0.0
    gain: float = 0.0
    row_gain: float = 0.0
    common_gain: float = 0.0
    dead: float = 0.0
    dead_unknown: float = 0.0
    displacement_noise_mm: float = 0.0
    displacement_zero_mm: float = 0.0
    displacement_drift_mm: float = 0.0
    position_mm: float = 0.0
    position_scale: float = 0.0
    force: float = 0.0
    creep: float = 0.0
    hysteresis: float = 0.0
    stuck: float = 0.0
    modulus: float = 0.0
    undulation: float = 0.0
    start_mm: float = 0.0
    quantise: bool = True

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if f.name != "quantise" and not 0 <= value < (1 if f.name in _BELOW_1 else 1e3):
                raise UsageError(
                    f"noise '{f.name}' is {value}: it must be 0 or more ({', '.join(_BELOW_1)}: below 1)"
                )

    def without(self, *names: str) -> Noise:
        """The same with the named disturbances at 0."""
        return self.with_(**dict.fromkeys(names, 0.0))

    def at_one_force(self) -> Noise:
        """The same in a steady hand, over tissue as it was simulated."""
        return self.without("force", "modulus", "undulation")

    def with_(self, **values: Any) -> Noise:
        """The same with some disturbances set."""
        return replace(self, **values)


LEVELS: dict[str, Noise] = {
    "none": Noise(),
    "good": Noise(
        white=0.001, offset=0.001, drift=0.0005, gain=0.01, dead=0.01,
        displacement_noise_mm=0.010, displacement_zero_mm=0.02, displacement_drift_mm=0.02,
        position_mm=0.1, position_scale=0.001, force=0.05, creep=0.005, start_mm=5.0,
        common_gain=0.01, modulus=0.01,
    ),
    "typical": Noise(
        white=0.0025, offset=0.002, drift=0.001, gain=0.02, dead=0.01,
        displacement_noise_mm=0.025, displacement_zero_mm=0.05, displacement_drift_mm=0.05,
        position_mm=0.25, position_scale=0.003, force=0.10, creep=0.01, start_mm=5.0,
        common_gain=0.02, modulus=0.02,
    ),
    "poor": Noise(
        white=0.005, offset=0.004, drift=0.002, gain=0.03, dead=0.01,
        displacement_noise_mm=0.050, displacement_zero_mm=0.1, displacement_drift_mm=0.1,
        position_mm=0.5, position_scale=0.005, force=0.20, creep=0.02, start_mm=5.0,
        common_gain=0.03, modulus=0.03,
    ),
}  # fmt: skip
LEVELS["real"] = LEVELS["typical"].with_(hysteresis=0.01, stuck=0.005, undulation=0.05)
"""Typical, and what an audit found missing from it."""


def level_named(name: str) -> Noise:
    """The noise of a named level, or of a file sensor.toml that `palpate characterise` has written.

    Raises
    ------
    UsageError
        There is no such level or file, or the file holds something else; the sentence says what.
    """
    if name in LEVELS:
        return LEVELS[name]
    if not name.endswith(".toml"):
        raise UsageError(
            f"there is no noise level {name!r}; there are {', '.join(LEVELS)}, and files as sensor.toml"
        )
    said = read_toml(Path(name), "sensor's file").get("noise")
    known = {f.name for f in fields(Noise)} - {"quantise"}
    if not isinstance(said, dict) or not said:
        raise UsageError(f"{name} has no [noise]; `palpate characterise` writes one")
    for key, value in said.items():
        if key not in known:
            raise UsageError(f"{name}: [noise] knows no {key!r}; it knows {', '.join(sorted(known))}")
        if not isinstance(value, int | float) or isinstance(value, bool):
            raise UsageError(f"{name}: {key} is a number, not {value!r}")
    return Noise().with_(**said)
