"""The reference press of a visit, as the probe keeps it."""

from __future__ import annotations

import math
from dataclasses import dataclass

_Q24 = 1 << 24


@dataclass(frozen=True)
class Reference:
    """What a press beside the lump says of the tissue; it joins what each stroke's own press says.

    Parameters
    ----------
    E_fat_kPa : float
        The fat's modulus.
    t_mm : float
        Its thickness.
    layers_mm : float
        Fat and gland together, as fat that gives as much.
    """

    E_fat_kPa: float
    t_mm: float
    layers_mm: float

    @classmethod
    def from_answer(cls, values: tuple[int, ...]) -> Reference | None:
        """From the fields of an answer to `reference`; None where the probe has none."""
        _, held, *logarithms = values
        return cls(*(math.exp(v / _Q24) for v in logarithms)) if held else None

    @classmethod
    def of_kept(cls, numbers: tuple[int, int, int]) -> Reference:
        """From what `kept` gives."""
        less_fat, *rest = numbers
        return cls(*(math.exp(v / _Q24) for v in (-less_fat, *rest)))


def kept(values: tuple[int, ...]) -> tuple[int, int, int] | None:
    """The same fields as the probe keeps them (`firmware_py.stage.Stage.set`), for a replay."""
    _, held, ln_fat, ln_t, ln_layers = values
    return (-ln_fat, ln_t, ln_layers) if held else None
