"""In which layer a lump lies, how deep, and what is known of its size where its stiffness is not.

The formulas of `schema.Layers`. All follows from the probe's outputs; only how sure it is does not, and is
worked out here from the features that it sends.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_py import outputs
from palpate.answer.across import Floats
from palpate.model_export.schema import Layers
from palpate.spans import Span, stiffness
from palpate.wire.events import OUTPUTS

PLACES = ("in the fat", "at the border", "in the gland", "unsure")
FAT, BORDER, GLAND, UNSURE = range(4)
FARTHEST = (-1.0, 2.0)
"""Of how much of the lump's height lies in the fat: a diameter under it, and as much over its lower end."""

WIDEST = 8.0
"""Half of an interval, at most: it tells nothing then."""

_T, _D, _H = (OUTPUTS.index(name) for name in ("t_mm", "d_mm", "h"))


def values(y: Floats, slope: float) -> Floats:
    """in_fat, ln of the depth, mm, and size, (n, 3), from outputs y (n, outputs) on the link scale."""
    in_fat = np.clip(np.exp(y[:, _T] - y[:, _D]) - np.exp(y[:, _H]), *FARTHEST)
    return np.column_stack([in_fat, y[:, _D] + y[:, _H], y[:, _D] + slope * y[:, outputs.E_INV23]])


def layer_of(in_fat: Floats) -> NDArray[np.int64]:
    """`FAT`, `BORDER` or `GLAND`, by how much of the lump's height lies in the fat, (n)."""
    return np.where(in_fat >= 1, FAT, np.where(in_fat <= 0, GLAND, BORDER))


def half_widths(part: Layers, z: Floats, of: Floats) -> Floats:
    """Half of the intervals of what `values` gives, (n, 3), at standardised features z (n, features)."""
    one = np.ones((len(z), 1))
    ln_sigma = [np.hstack([one, z, of[:, [j]]]) @ np.array(row) for j, row in enumerate(part.spread)]
    sigma = np.exp(np.minimum(np.column_stack(ln_sigma), np.log(WIDEST)))
    out: Floats = np.minimum(sigma * np.array(part.quantiles)[:, layer_of(of[:, 0])].T, WIDEST)
    return out


def odds(in_fat: Floats, half: Floats, level: float) -> Floats:
    """Of fat, border and gland, (n, 3): normal errors, of which `half` holds a share `level`."""
    below = np.vectorize(NormalDist().cdf)
    sd = half / NormalDist().inv_cdf((1 + level) / 2)
    fat, over = below((in_fat - 1) / sd), below(in_fat / sd)
    return np.column_stack([fat, over - fat, 1 - over])


def said(of: Floats, sure: float) -> NDArray[np.int64]:
    """Of `PLACES`, (n): the layer whose odds, (n, 3), are `sure` at least."""
    return np.where(of.max(1) < sure, UNSURE, of.argmax(1))


@dataclass(frozen=True)
class LumpLayer:
    """Where a lump lies, and its size if somebody knew its stiffness.

    Attributes
    ----------
    level : float
        Coverage of the intervals.
    place : str
        Of `PLACES`.
    odds : dict
        Of the first three, by name.
    in_fat : (float, float, float)
        Value, low, high: how much of the lump's height lies in the fat; under 0 and over 1 it is a distance
        from the border in diameters.
    depth_mm : (float, float, float)
        Tissue over the lump.
    sizes : pairs of float
        A stiffness, times fat, and the diameter, mm, that goes with it: both ends of the stiffness' interval.
        None: so stiff that more makes no difference.
    within : float
        Each of these diameters is known to this share.
    worth_saying : bool
        Whether they are known better than the diameter itself.
    """

    level: float
    place: str
    odds: dict[str, float]
    in_fat: Span
    depth_mm: Span
    sizes: tuple[tuple[float | None, float], ...]
    within: float
    worth_saying: bool

    def as_dict(self) -> dict[str, Any]:
        """As `--json` prints it; the depth stands beside it, in place of the one that the tie tells."""
        sizes = [{"E_over_fat": E, "d_mm": d} for E, d in self.sizes]
        return {
            "level": self.level,
            "place": self.place,
            "odds": self.odds,
            "in_fat": dict(zip(outputs.PARTS, self.in_fat)),
            "size": {"if": sizes, "within": self.within, "worth_saying": self.worth_saying},
        }


def lump_layer(part: Layers, z: Floats, answer: Sequence[Span]) -> LumpLayer | None:
    """What the document's part adds to an answer, spans by `OUTPUTS`, at standardised features z (features).

    None of an answer that is none: lengths of nothing.
    """
    if min(answer[j][0] for j in (_T, _D, _H)) <= 0:
        return None
    logarithmic = np.array(outputs.LOGARITHMIC)
    value = np.array([[span[0] for span in answer]])
    y = np.where(logarithmic, np.log(np.where(logarithmic, np.maximum(value, 1e-9), 1.0)), value)
    of = values(y, part.slope)
    half = half_widths(part, z[None], of)
    chances = odds(of[:, 0], half[:, 0], part.level)
    in_fat, ln_depth, size = of[0]
    of_share, of_depth, of_size = half[0]
    _, least, most = answer[outputs.E_INV23]
    stiff = stiffness(answer[outputs.E_INV23])[1:]
    sizes = [math.exp(size - part.slope * end) for end in (most, max(least, 0.0))]
    _, smallest, largest = answer[_D]
    return LumpLayer(
        level=part.level,
        place=PLACES[said(chances, part.sure)[0]],
        odds=dict(zip(PLACES, map(float, chances[0]))),
        in_fat=(in_fat, max(in_fat - of_share, FARTHEST[0]), min(in_fat + of_share, FARTHEST[1])),
        depth_mm=(math.exp(ln_depth), math.exp(ln_depth - of_depth), math.exp(ln_depth + of_depth)),
        sizes=tuple(zip(stiff, sizes)),
        within=math.expm1(of_size),
        worth_saying=of_size < math.log(largest / smallest) / 2,
    )
