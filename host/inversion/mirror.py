"""Where along a stroke the lump lies: about its middle the stroke is its own mirror image.

Face and tissue are alike fore and aft, so rows felt u before a lump are those felt u behind it, in reverse.
Neither tissue nor lump need be known for that. A shallow, soft lump that the features of the regression take
for another part of the stroke is found so.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.inversion.felt import FeltStroke

Floats = NDArray[np.float64]

_REACH_MM, _KNOT_MM, _STEP_MM = 20.0, 2.0, 1.0
"""A lump is felt so far to either side; what is felt of it is linear between knots."""
_MARGIN_MM = 12.0
"""Nearer to an end of the stroke too little of the lump is felt from its other side."""
_APART_MM = 4.0
_CLEAR = 1.3
"""Other places leave so many times as much: 1.1 where no lump is seen, 2 and more where one is."""


def mirrored_about(stroke: FeltStroke) -> float | None:
    """The place along the stroke, mm, that it is a mirror image about; None where it is not clear."""
    place = stroke.place_mm[stroke.press :]
    centres = np.arange(place.min() + _MARGIN_MM, place.max() - _MARGIN_MM, _STEP_MM)
    left = _unexplained(stroke, centres)
    best = int(left.argmin())
    others = left[np.abs(centres - centres[best]) > _APART_MM]
    return float(centres[best]) if len(others) and others.min() > _CLEAR * left[best] else None


def _unexplained(stroke: FeltStroke, centres: Floats) -> Floats:
    """What is left of the rows over the force, squared, when a mirror image about each place is taken off.

    Of each row that is a mean, a drift, a change with the force, and what is felt of a lump at a distance,
    which the row at the other end of the face feels on the lump's other side.
    """
    p = stroke.press
    place, rows = stroke.place_mm[p:], stroke.rows_kPa[p:]
    force = rows.sum(1, keepdims=True) / rows.mean(0).sum()
    shape = rows / force
    fore = (shape.shape[1] + 1) // 2
    felt = np.vstack([shape[:, :fore], shape[:, ::-1][:, :fore]])
    plain = np.kron(np.eye(2), np.column_stack([np.ones(len(place)), stroke.share[p:], force - 1]))
    knots = np.arange(0.0, _REACH_MM, _KNOT_MM)
    out = []
    for centre in centres:
        apart = (place - centre)[:, None]
        near = np.maximum(1 - np.abs(np.abs(apart) - knots) / _KNOT_MM, 0.0)
        before, behind = near * (apart < 0), near * (apart >= 0)
        columns = np.hstack([plain, np.block([[behind, before], [before, behind]])])
        left = felt - columns @ np.linalg.lstsq(columns, felt, rcond=1e-8)[0]
        out.append(float((left**2).sum()))
    return np.array(out)
