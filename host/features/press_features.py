"""The features that tell of the press before a stroke: their names and places among the firmware's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from firmware_py import feature_names, features
from palpate.model_export.vocabulary import OF_THE_PRESS

Floats = NDArray[np.float64]

OUTER = feature_names.NAMES[features.PRESS_OUTER : features.PRESS_OUTER + 3]
NAMES = OF_THE_PRESS
PLACES = [feature_names.NAMES.index(name) for name in NAMES]
"""Where these stand among the firmware's."""


def named(X: Floats, names: Sequence[str]) -> Floats:
    """The columns of these names, (n, names), of features of the press, (n, NAMES)."""
    return X[:, [NAMES.index(name) for name in names]]
