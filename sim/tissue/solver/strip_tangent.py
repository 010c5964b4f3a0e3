"""What `strip.py` factors: the elements' tangents without their middle nodes, and the contact's."""

# mypy: ignore-errors
from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit


class Tangent(NamedTuple):
    """What is factored.

    Attributes
    ----------
    packed : ndarray (M, 136)
        Upper triangles of the elements without their middles (`condense_elements`).
    contact : ndarray (S, 3)
        Blocks xx, xy and yy of the surface's nodes.
    """

    packed: np.ndarray
    contact: np.ndarray


@njit(cache=True, nogil=True)
def condense_elements(K, which, condensed, packed):
    """Eliminate the middle node of elements `which`; the rest's upper triangle goes to `packed` (M, 136).

    packed = K_rr - K_rm K_mm^-1 K_mr,   condensed = K_mm^-1 K_mr, with K_mm^-1 in the middle's own places
    """
    for e in which:
        k = K[e]
        # Places of the middle node in the element's 18 are 4 (x) and 13 (y).
        a = k[4, 4]
        b = k[4, 13]
        d = k[13, 13]
        det = a * d - b * b
        if not (det > 0.0 and a > 0.0):
            return False
        ia = d / det
        ib = -b / det
        ic = a / det
        u = condensed[e, 0]
        v = condensed[e, 1]
        for c in range(18):
            u[c] = ia * k[4, c] + ib * k[13, c]
            v[c] = ib * k[4, c] + ic * k[13, c]
        m = 0
        for r in range(18):
            if r == 4 or r == 13:
                continue
            x = k[4, r]
            y = k[13, r]
            if r < 4:
                for c in range(r, 4):
                    packed[e, m] = k[r, c] - x * u[c] - y * v[c]
                    m += 1
            for c in range(max(r, 5), 13):
                packed[e, m] = k[r, c] - x * u[c] - y * v[c]
                m += 1
            for c in range(max(r, 14), 18):
                packed[e, m] = k[r, c] - x * u[c] - y * v[c]
                m += 1
        u[4] = ia
        u[13] = ib
        v[4] = ib
        v[13] = ic
    return True
