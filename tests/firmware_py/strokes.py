"""The committed finite-element strokes (made by make_strokes.py), read."""

import dataclasses

import numpy as np

from palpate.sim.tissue import Case, Stroke
from tests.firmware_py.make_strokes import FILE


def _stroke(code, positions, images, depths):
    """A stroke of which only what the sensors need is known."""
    values = dict.fromkeys((f.name for f in dataclasses.fields(Stroke)), 0)
    values |= {
        "case": Case.from_code(code),
        "positions_mm": positions,
        "images_kPa": np.float64(images),
        "displacement_mm": np.float64(depths),
    }
    return Stroke(**values)


def read_strokes():
    """Pairs (low, high) of strokes at two forces; the last pair has no lump."""
    table = np.load(FILE)
    rows = zip(table["codes"], table["images_kPa"], table["depths_mm"], strict=True)
    strokes = [_stroke(str(code), table["positions_mm"], images, depths) for code, images, depths in rows]
    return list(zip(strokes[::2], strokes[1::2], strict=True))
