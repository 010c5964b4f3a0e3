"""Inversion by the forward model: the tissue and the lump whose computed stroke fits the measured one.

    from palpate.inversion import invert

    for found in invert("visit.mcap"):
        found.values["d_mm"], found.fits, found.classes

`felt` is what the sensors have given, `classes` what may lie under the probe, `posterior` how well a guess
explains the data, `search` the way to the best one, `result` what is said of it.
"""

from palpate.answer.fitted import Inverted, Value
from palpate.inversion.strokes import invert, invert_stroke

__all__ = ["Inverted", "Value", "invert", "invert_stroke"]
