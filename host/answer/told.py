"""What the host adds to a probe's answer: a lump's width across the stroke and its place there, with
intervals (the formulas of `schema.Across`), or the layer that it lies in (`layers`); of a stroke that the
model is not for, why (`outside`).

The probe's answer has six outputs and its memory no room for more, so these are worked out here, from the
features that it sends and from how much of the bump each of its columns saw. Units: mm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from firmware_py import feature_names
from firmware_py import features as firmware_features
from firmware_py.outputs import PARTS
from palpate.answer.across import across
from palpate.answer.layers import LumpLayer, lump_layer
from palpate.answer.outside import why_outside
from palpate.model_export.integers.reference import estimates, inputs, standardised
from palpate.model_export.schema import Across, ModelSpec
from palpate.spans import Span

FEATURE_ONE = 1 << 24
"""Of the features' integers, as the firmware has them and sends them."""


@dataclass(frozen=True)
class AcrossStroke:
    """Value, low and high of each, mm; None where it cannot be told.

    Attributes
    ----------
    level : float
        Coverage of the intervals.
    width_mm : (float, float, float) or None
    place_mm : (float, float, float) or None
        Of the lump's middle from the face's, positive towards the last column.
    """

    level: float
    width_mm: Span | None = None
    place_mm: Span | None = None

    def as_dict(self) -> dict[str, Any]:
        """As `--json` prints it."""
        spans = {"width_mm": self.width_mm, "place_mm": self.place_mm}
        said = {name: None if span is None else dict(zip(PARTS, span)) for name, span in spans.items()}
        return {"level": self.level, **said}


@dataclass(frozen=True)
class Told:
    """What is added to one answer; None: that model does not tell it, or what it takes did not come.

    `outside`: why the model is not for this stroke, as `answer.outside_words` knows it.
    """

    across: AcrossStroke | None = None
    layer: LumpLayer | None = None
    outside: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """As `--json` prints it beside the answer."""
        return {
            "across": None if self.across is None else self.across.as_dict(),
            "layer": None if self.layer is None else self.layer.as_dict(),
            "outside": list(self.outside),
        }


def told(
    spec: ModelSpec,
    features: Sequence[int] | None,
    columns: Sequence[int] | None,
    answer: Sequence[Span] = (),
    in_domain: bool = True,
) -> Told:
    """What the model tells of a stroke over a lump.

    Parameters
    ----------
    spec : ModelSpec
    features : the firmware's, Q24, as the probe sent them or a replay worked them out; None: not known
    columns : how much of the bump each column saw (`Pipeline.columns`); None: frames are missing, or all saw
        as much
    answer : the probe's, value, low and high of each output
    in_domain : whether the probe says that the model is for such strokes
    """
    try:
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            return _told(spec, features, columns, answer, in_domain)
    except (ArithmeticError, ValueError):  # numbers that no stroke gives: nothing follows from them
        return Told()


def _told(
    spec: ModelSpec,
    features: Sequence[int] | None,
    columns: Sequence[int] | None,
    answer: Sequence[Span],
    in_domain: bool,
) -> Told:
    x = None
    if features is not None and len(features) >= _least_count(spec):
        known = [*features, *[firmware_features.ABSENT] * (firmware_features.COUNT - len(features))]
        x = inputs(spec, np.array([known], float) / FEATURE_ONE)
    layer = None
    if spec.layers is not None and x is not None and answer:
        layer = lump_layer(spec.layers, standardised(spec, x)[0], answer)
    outside = () if in_domain or x is None else why_outside(spec, x)
    return Told(_across(spec, x, columns), layer, outside)


def _across(spec: ModelSpec, x: np.ndarray | None, columns: Sequence[int] | None) -> AcrossStroke | None:
    part = spec.across
    if part is None:
        return None
    width = None if x is None else _width(spec, part, x)
    place = _place(part, columns) if columns is not None and any(columns) else None
    return AcrossStroke(part.level, width, place)


def _least_count(spec: ModelSpec) -> int:
    """How many features a firmware must send: an older one than this knows fewer."""
    first = () if spec.first is None else spec.first.features
    names = {*spec.features, *first} & {*feature_names.NAMES}
    return 1 + max(feature_names.NAMES.index(name) for name in names)


def _width(spec: ModelSpec, part: Across, inputs: np.ndarray) -> Span:
    own = [spec.features.index(name) for name in part.width.features]
    x = inputs[:, own]
    (y,) = estimates(part.width, x)[0]
    (z,) = standardised(part.width, x)
    half = math.exp(float(np.dot(part.width_spread, [1.0, *z, y])))
    return math.exp(y), math.exp(y - half), math.exp(y + half)


def _place(part: Across, columns: Sequence[int]) -> Span:
    bump = across(np.array(columns, float))
    value = part.place_stretch * bump.place_mm
    first, exponent = part.place_spread
    half = math.exp(first + exponent * bump.ln_blur)
    return value, value - half, value + half
