"""A stroke's frames from those at fewer places, where the face stands alike on the mesh.

While the face slides, nodes enter and leave its contact, and pressures ripple with the mesh's columns. What a
frame says of its place would be that ripple: in the plane the derivative is off by more than itself. A whole
number of columns on, the ripple is the same. So the solver is asked at the column next to each frame, and
cubic splines lead from there to the frames: at place x and force F,

    I = S(x) + S_F(x) (ln F - S_lnF(x))

with S, S_F and S_lnF through the images, their derivatives by ln F and the forces at those places. A press
is computed at the nearest of them, frame by frame. Units: mm, N/m.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.linalg import block_diag

Floats = NDArray[np.float64]

_CLOSE_MM = 7.0
"""So near the lump every column is a place: a small lump under thin skin shows in one row after the other."""
_NEAR_MM, _APART_MM = 24.0, 4.0
"""And so near it places are no farther apart than that, however few frames there are."""


@dataclass(frozen=True)
class Track:
    """Where n frames' pressures come from.

    Attributes
    ----------
    places_mm, forces_N_per_m : ndarray (m,)
        Where the solver is asked.
    shares, steep : ndarray (n, m)
        Shares of what it says there in each frame, and their derivatives by the frame's place.
    apart : ndarray (n,)
        ln of the frames' forces over what the shares make of those.
    """

    places_mm: Floats
    forces_N_per_m: Floats
    shares: Floats
    steep: Floats
    apart: Floats

    def frames(self, there: Floats, by_force: Floats) -> Floats:
        """Values (n, ...) in the frames, from those (m, ...) at the places, and their slopes by ln F."""
        return _times(self.shares, there) + _each(self.apart, _times(self.shares, by_force))

    def by_place(self, there: Floats, by_force: Floats) -> Floats:
        """Their derivatives (n, ...) by the frames' places."""
        changes = self.steep @ np.log(self.forces_N_per_m)
        return (
            _times(self.steep, there)
            + _each(self.apart, _times(self.steep, by_force))
            - _each(changes, _times(self.shares, by_force))
        )

    def of_shares(self, there: Floats) -> Floats:
        """Values (n, ...) of what the forces do not change, from those (m, ...) at the places."""
        return _times(self.shares, there)


def nodes_mm(places_mm: Floats, column_mm: float) -> Floats:
    """Where a stroke whose frames stand at these places is computed on a mesh of such columns, ascending.

    At the column next to every frame, whose force is then nearly the frame's own; one more at either end.
    """
    at = set(np.rint(places_mm / column_mm).astype(int).tolist())
    first, last = min(at) - 1, max(at) + 1
    close = int(_CLOSE_MM / column_mm)
    at |= {first, last, *range(max(first, -close), min(last, close) + 1)}
    apart, near = int(_APART_MM / column_mm), _NEAR_MM / column_mm
    for a, b in pairwise(sorted(at)):
        if min(abs(a), abs(b)) < near:
            pieces = -(-(b - a) // apart)
            at |= {a + round((b - a) * k / pieces) for k in range(1, pieces)}
    return column_mm * np.array(sorted(at), float)


def track(
    places_mm: Floats, forces_N_per_m: Floats, press: int, column_mm: float, before: Track | None = None
) -> Track:
    """The track of one stroke.

    Parameters
    ----------
    places_mm, forces_N_per_m : ndarray (n,)
        Of the frames, from the lump.
    press : int
        So many of the first stand where the stroke begins.
    column_mm : float
        Of the mesh.
    before : Track, optional
        Of a guess nearby: places stay while every frame is within a column of one.
    """
    x, ln_F = places_mm[press:], np.log(forces_N_per_m)
    nodes = np.empty(0) if before is None else before.places_mm[: before.places_mm.size - press]
    if not nodes.size or np.abs(x[:, None] - nodes).min(1).max() > column_mm:
        nodes = nodes_mm(x, column_mm)
    order = np.argsort(x, kind="stable")
    ln_there = np.interp(nodes, x[order], ln_F[press:][order])
    spline = CubicSpline(nodes, np.eye(len(nodes)))
    within = np.clip(places_mm, nodes[0], nodes[-1])
    shares, steep = spline(within), spline(within, 1)
    steep[within != places_mm] = 0.0
    stands = nodes[np.abs(nodes - places_mm[0]).argmin()]
    if press and before is not None and abs(before.places_mm[-1] - places_mm[0]) <= column_mm:
        stands = before.places_mm[-1]
    shares[:press] -= spline(stands)
    apart = ln_F - shares @ ln_there
    apart[:press] = 0.0
    pressed = np.eye(len(places_mm), press)
    return Track(
        np.append(nodes, np.full(press, stands)),
        np.exp(np.append(ln_there, ln_F[:press])),
        np.hstack([shares, pressed]),
        np.hstack([steep, np.zeros_like(pressed)]),
        apart,
    )


def side_by_side(tracks: Sequence[Track]) -> Track:
    """Of several strokes, one after the other."""
    return Track(
        np.concatenate([one.places_mm for one in tracks]),
        np.concatenate([one.forces_N_per_m for one in tracks]),
        block_diag(*(one.shares for one in tracks)),
        block_diag(*(one.steep for one in tracks)),
        np.concatenate([one.apart for one in tracks]),
    )


def _times(shares: Floats, there: Floats) -> Floats:
    out: Floats = np.tensordot(shares, there, 1)
    return out


def _each(of_frame: Floats, values: Floats) -> Floats:
    return of_frame.reshape(-1, *[1] * (values.ndim - 1)) * values
