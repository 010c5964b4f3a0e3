"""The border of the contact, between the last node that touches and the first that does not.

Towards it the pressure falls as the root of the distance (Hertz, 1882), so its square is a straight line. A
node's force is the integral of its shape function with the pressure: what the last node bears beside the next
one inside tells how far out the border lies. Straight lines between the nodes' pressures put it at the next
node, and read a row there up to a tenth wrong. Units: mm, kPa.
"""

# mypy: ignore-errors
from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_SHARES = 129
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(4)


def last_over_next(x0: Floats) -> Floats:
    """Pressures of last nodes over those of the next inside, (2, n, 129).

    Parameters
    ----------
    x0 : ndarray (n,)
        Nodes of a line of quadratic elements: ends and middles in turn.

    Returns
    -------
    ndarray (2, n, 129)
        With the contact to the right of a node and to its left, and the border 0 to 1 of the way to the next
        node outside. A pressure is a node's force over the integral of its shape function.
    """
    lengths = np.diff(x0[::2])
    out = np.ones((2, len(x0), _SHARES))
    out[:, 1::2] = _of_middle()
    for k, (left, right) in enumerate(pairwise(lengths), 1):
        out[0, 2 * k] = _of_end(round(left / right, 9))
        out[1, 2 * k] = _of_end(round(right / left, 9))
    return out


@cache
def _of_middle() -> Floats:
    return _borne(1, -0.5, 1.0, inside=0.5, outside=0.5) / (2 / 3)


@cache
def _of_end(outer: float) -> Floats:
    """Of an element's end, where that outside is so many times as long as that inside."""
    force = _borne(2, -outer, outer, 0.5, outer / 2) + _borne(0, 0.0, 1.0, 0.5, outer / 2)
    return force / ((1.0 + outer) / 6)


def _borne(own: int, first: float, length: float, inside: float, outside: float) -> Floats:
    """Integrals (129,) of an element's shape function with the pressure beside a node at 0, which is 1 at the
    next inside, by where the border is. Over the root of the way from the border they are of polynomials."""
    border = np.linspace(0.0, outside, _SHARES)[:, None]
    low, high = np.sqrt(np.maximum(first + border, 0.0)), np.sqrt(first + length + border)
    root = (low + high + (high - low) * _POINTS) / 2
    s = (root**2 - border - first) / length
    N = ((1 - s) * (1 - 2 * s), 4 * s * (1 - s), s * (2 * s - 1))[own]
    whole: Floats = (high - low) * (N * root**2) @ _WEIGHTS[:, None] / np.sqrt(inside + border)
    return whole[:, 0]


@njit(cache=True, nogil=True, inline="always")
def _by_force(last, inner, inside, outside, ratios):
    """p^2 at a last node and at the next outside: on a straight line from inside that is 0 at the border."""
    beyond = outside * np.interp(last / inner, ratios, np.linspace(0.0, 1.0, len(ratios)))
    slope = inner * inner / (inside + beyond)
    return slope * beyond, slope * (beyond - outside)


@njit(cache=True, nogil=True, inline="always")
def squares(p, ways, ratios, next_ratios):
    """p^2 at the next node inside, at the last that touches and at the next one outside.

    Of pressures p at the last node and at the two next inside, and ways from the next one outside to the last
    node and from there on. A node that bears less than it would with the border at itself hardly touches: so
    much less does it count beside what the nodes inside say without it, and no row jumps where it lets go.
    """
    own, beyond = _by_force(p[0], p[1], ways[1], ways[0], ratios)
    touches = p[0] / (p[1] * ratios[0])
    if touches >= 1.0 or p[2] <= 0.0:
        return p[1] * p[1], own, beyond
    inner, hardly = _by_force(p[1], p[2], ways[2], ways[1], next_ratios)
    return touches * p[1] * p[1] + (1.0 - touches) * inner, (1.0 - touches) * hardly, touches * beyond


@njit(cache=True, nogil=True, inline="always")
def _root_integral(q0, q1, length):
    """Of the root of what goes from q0 to q1 over a length in a straight line, where that is above 0."""
    high = max(q0, q1)
    low = min(q0, q1)
    if high <= 0.0:
        return 0.0
    if low < 0.0:
        length *= high / (high - low)
        low = 0.0
    a = np.sqrt(high)
    b = np.sqrt(low)
    return length * 2.0 / 3.0 * (high + low + a * b) / (a + b)


@njit(cache=True, nogil=True)
def mean_pressures(s, p, ratios, ends):
    """Mean pressure (n,) between ends (n, 2), of pressures p at places s; p^2 is straight between them."""
    count = len(s)
    q = p * p
    for b in range(1, count - 1):
        for side in range(2):
            d = 1 - 2 * side
            if p[b] > 0.0 and p[b - d] == 0.0 and p[b + d] > 0.0 and 0 <= b + 2 * d < count:
                ways = abs(s[b] - s[b - d]), abs(s[b + d] - s[b]), abs(s[b + 2 * d] - s[b + d])
                last = p[b], p[b + d], p[b + 2 * d]
                q[b + d], q[b], q[b - d] = squares(last, ways, ratios[side, b], ratios[side, b + d])
    total = np.zeros(count)
    for k in range(count - 1):
        total[k + 1] = total[k] + _root_integral(q[k], q[k + 1], s[k + 1] - s[k])
    out = np.empty(len(ends))
    for i in range(len(ends)):
        force = 0.0
        for end in range(2):
            x = min(max(ends[i, end], s[0]), s[-1])
            k = min(max(np.searchsorted(s, x, side="right") - 1, 0), count - 2)
            length = x - s[k]
            there = q[k] + (q[k + 1] - q[k]) * length / (s[k + 1] - s[k])
            force += (2 * end - 1) * (total[k] + _root_integral(q[k], there, length))
        out[i] = force / (ends[i, 1] - ends[i, 0])
    return out


_STEP = 1e-6
"""mm or kPa."""


@njit(cache=True, nogil=True)
def mean_pressure_changes(s, p, ds, dp, ratios, ends):
    """How `mean_pressures` change (k, n) with changes ds, dp (k, nodes)."""
    now = mean_pressures(s, p, ratios, ends)
    out = np.empty((len(ds), len(ends)))
    for k in range(len(ds)):
        step = _STEP / max(np.abs(ds[k]).max(), np.abs(dp[k]).max(), 1e-12)
        out[k] = (mean_pressures(s + step * ds[k], p + step * dp[k], ratios, ends) - now) / step
    return out
