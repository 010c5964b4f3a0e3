"""The words of a model: kinds, outputs, links, terms."""

from __future__ import annotations

from firmware_py import feature_names, features, outputs

KINDS = ("thesis", "field")
# Name and unit of the outputs in the order of the wire; an image holds millionths of these units.
OUTPUTS = tuple(zip(outputs.NAMES, outputs.UNITS))
SYMBOLS = tuple(name.removesuffix("_" + unit.replace("/", "_per_")) for name, unit in OUTPUTS)
"""The outputs as equations name them: F, t, d, h, E_inv23."""
WORDS = {row[0]: row[3] for row in outputs.TABLE}
"""The outputs in plain words."""
SHOWN_UNITS = {name: "" if unit == "1" else unit for name, unit in OUTPUTS}
"""Their units as people are shown them."""
LINKS = ("ln", "identity")
OF_THE_PRESS = tuple(
    name
    for first, n in ((features.PRESS, 9), (features.PRESS_OUTER, 3))
    for name in feature_names.NAMES[first : first + n]
)
"""The firmware's features that a stroke has only where a press preceded it."""
OF_THE_COLUMNS = feature_names.NAMES[features.ACROSS : features.ACROSS_END]
"""Those of the columns that see the lump."""
ABSENT = features.ABSENT / 2**24
"""What stands for a feature of the press where there was no press, or too little of one."""

UNTOLD = 1e-3
"""Ends of an output that a model does not tell: it is 0."""

Term = tuple[int, ...]
