"""What a model of lumps anywhere is for, and how sure it is of the layer, of the depth and of the combination
of size and stiffness: its two stages are those of `any_tissue`."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from palpate.answer.layers import BORDER, FAT, GLAND, PLACES, half_widths, layer_of, values
from palpate.features.map_features import Floats
from palpate.learn.any_tissue.model import (
    OUTPUTS,
    RANGES,
    STIFFNESS,
    Parts,
    Scope,
    quarters,
    truth,
)
from palpate.learn.any_tissue.observed import ObservedInTissue
from palpate.learn.conformal import LEVEL, fit_sigma, quantile_of_part
from palpate.learn.probe_model import floats
from palpate.model_export.schema import Layers

SURE = 0.8
"""A place is said where its odds are at least this."""


def true_place(seen: ObservedInTissue) -> NDArray[np.int64]:
    """Where each lump lies, (n), of `PLACES`."""
    return layer_of(true_values(seen, 0.0)[:, 0])


def true_values(seen: ObservedInTissue, slope: float) -> Floats:
    """(n, 3), as `palpate.answer.layers.values`."""
    return values(truth(seen), slope)


def places(seen: ObservedInTissue) -> Parts:
    """Those of each layer, by name."""
    return {PLACES[k]: true_place(seen) == k for k in (FAT, BORDER, GLAND)}


def _parts(seen: ObservedInTissue) -> Parts:
    return quarters(seen) | places(seen)


FEATURES = (
    *("asinh_amp", "ln_stdev", "ln_centre_share", "ln_misfit", "asinh_rise", "trace_7_9", "trace_12_16"),
    *("tilt_3_5", "tilt_6_9", "dip_0_2", "dip_12_16", "ln_peak", "ln_width_near", "ln_width_far"),
    *("lift_0_2", "lift_7_9", "lift_12_16", "lift_17_22", "base_share"),
)
"""Of the stroke; found as `any_tissue.model.STROKE` was, on these lumps."""

ANYWHERE = Scope(
    MappingProxyType(
        RANGES
        | {
            "ln t": (float(np.log(4.0)), float(np.log(30.0))),
            "ln h": (float(np.log(2.0 / 20.0)), float(np.log(30.0 / 5.0))),
        }
    ),
    _parts,
    FEATURES,
)
"""The fat's thickness for itself; depth is no output, but h holds it roughly: 2 mm under the skin to 30."""


def slope_of(y: Floats, Y: Floats) -> float:
    """c of ln d + c E^-2/3 whose errors spread least, from estimates and truth (n, outputs)."""
    error = (y - Y)[:, [OUTPUTS.index("ln d"), STIFFNESS]]
    covariance = np.cov(error.T)
    return float(-covariance[0, 1] / covariance[1, 1])


def fit_layers(z: Floats, y: Floats, seen: ObservedInTissue) -> Layers:
    """Learn from estimates y (n, outputs) of lumps left out, at standardised features z (n, features)."""
    slope = slope_of(y, truth(seen))
    of = values(y, slope)
    error = true_values(seen, slope) - of
    spread = [fit_sigma(z, of[:, [j]], error[:, [j]], seen.group)[1][:, 0] for j in range(of.shape[1])]
    unit = Layers(LEVEL, slope, tuple(map(floats, spread)), ((1.0,) * 3,) * 3, SURE)
    score = np.abs(error) / half_widths(unit, z, of)
    layer = layer_of(of[:, 0])
    quantiles = [[quantile_of_part(q, layer == k, LEVEL) for k in (FAT, BORDER, GLAND)] for q in score.T]
    return Layers(LEVEL, slope, unit.spread, tuple((a, b, c) for a, b, c in quantiles), SURE)
