"""A finite-element stroke as a field: the image at any position and near any force. Units: mm, kPa, N/m."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PchipInterpolator

from palpate.errors import UsageError
from palpate.sim.tissue import Stroke
from palpate.sim.tissue.symmetry import both_sides
from palpate.wire.cells import COLUMN_MM, PITCH_MM, ROW_MM

Floats = NDArray[np.float64]

FORCE_RATIO = 1.4
"""Greatest over smallest force of a lump's strokes: room for a hand that wanders by 18 %."""


class StrokeField:
    """Images and displacement of one case at any position and, with two strokes or more, near any force.

    Parameters
    ----------
    *strokes : Stroke
        The same case at rising forces, from at least 28 mm before the lump to over it; the other side is the
        mirror image. Over a solid lump the images are those of the whole face.

        Between and around the forces each cell's pressure is the parabola in the force through the three
        nearest, the displacement's logarithm that in the logarithm of the force. The sum of all cells goes
        as the force, which a parabola in the force reproduces: no force is lost in between, and a cell at
        the edge that lifts off needs no logarithm. Between two forces alone pressures are interpolated in
        the logarithm where both are over .3 kPa, else linearly.
    """

    def __init__(self, *strokes: Stroke) -> None:
        positions = strokes[0].positions_mm
        for s in strokes:
            if len(s.positions_mm) != len(positions) or not np.allclose(s.positions_mm, positions):
                raise UsageError(f"{s.code} was simulated at other positions than {strokes[0].code}")
        self.forces_N_per_m = np.array([s.F_N_per_m for s in strokes])
        for a, b in itertools.pairwise(strokes):
            if not b.F_N_per_m > a.F_N_per_m:
                raise UsageError(f"{b.code} must be pressed harder than {a.code}")
        self.low = strokes[0]
        images = [on_the_array(s) for s in strokes]
        self.shape = images[0].shape[1:]
        x, tables = positions, []
        for s, image in zip(strokes, images, strict=True):
            depth = np.asarray(s.displacement_mm, float)
            if len(positions) == 1:
                x, image, depth = (
                    np.array([-40.0, 0.0, 40.0]),
                    np.repeat(image, 3, axis=0),
                    np.repeat(depth, 3),
                )
            else:
                x, image, depth = both_sides(positions, image, depth)
            tables.append(np.column_stack([image.reshape(len(x), -1), depth]))
        self.reach_mm = (float(x[0]), float(x[-1]))
        self._spline = CubicSpline(x, np.stack(tables, axis=1))

    @property
    def one_force(self) -> bool:
        """Whether the hand's force cannot vary over this field."""
        return len(self.forces_N_per_m) == 1

    @property
    def middle_N_per_m(self) -> float:
        """The force midway between the smallest and the greatest, geometrically."""
        return float(np.sqrt(self.forces_N_per_m[0] * self.forces_N_per_m[-1]))

    def at(self, position_mm: Floats, force_N_per_m: Floats | None = None) -> tuple[Floats, Floats]:
        """Images (n, rows), of a solid lump (n, rows, columns), in kPa, and displacement (n,) in mm.

        At places position_mm (n,) and forces force_N_per_m (n,).

        Outside the simulated places the last image stays.
        """
        x = np.clip(np.asarray(position_mm, float), *self.reach_mm)
        forces = self.forces_N_per_m
        wanted = np.broadcast_to(forces[0] if force_N_per_m is None else force_N_per_m, x.shape)
        if self.one_force and not np.allclose(wanted, forces[0], rtol=1e-9):
            raise UsageError(f"{self.low.code} was simulated at one force only: the hand cannot vary it")
        tables = np.maximum(self._spline(x), 0).swapaxes(0, 1)
        near = _nearest(forces, wanted)
        tables = np.take_along_axis(tables, near.T[:, :, None], axis=0)
        shares = _lagrange(np.log(forces[near]), np.log(wanted))
        out = np.maximum(np.einsum("nk,knm->nm", _lagrange(forces[near], wanted), tables), 0)
        if len(forces) == 2:
            loaded = (tables > 0.3).all(axis=0)
            logs = np.einsum("nk,knm->nm", shares, np.log(np.where(loaded, tables, 1.0)))
            out = np.where(loaded, np.exp(logs), out)
        out[:, -1] = np.exp(np.einsum("nk,kn->n", shares, np.log(np.maximum(tables[:, :, -1], 1e-6))))
        return out[:, :-1].reshape(-1, *self.shape), out[:, -1]


def _nearest(nodes: Floats, wanted: Floats) -> NDArray[np.int64]:
    """Which three neighbouring nodes (or as many as there are) lie nearest each of `wanted`, (n, 3)."""
    k = min(len(nodes), 3)
    middles = np.log([nodes[i : i + k].mean() for i in range(len(nodes) - k + 1)])
    first = np.abs(np.log(wanted)[:, None] - middles).argmin(1)
    return first[:, None] + np.arange(k)


def _lagrange(nodes: Floats, x: Floats) -> Floats:
    """Shares (n, k) of values at nodes (n, k) in the polynomial through them at x (n,)."""
    k = nodes.shape[1]
    out = np.ones(nodes.shape)
    for i in range(k):
        for j in range(k):
            if i != j:
                out[:, i] *= (x - nodes[:, j]) / (nodes[:, i] - nodes[:, j])
    return out


def on_the_array(stroke: Stroke) -> Floats:
    """A stroke's images (n, rows) or (n, rows, columns) as this probe's array feels them.

    The tissue gives mean pressures on sensors of its own; where the array's lie elsewhere, the force on each
    cell is taken from the running integral (monotone cubic: no force is lost, none turns negative). What lies
    beyond the tissue's sensors is not touched.
    """
    pressure = np.asarray(stroke.images_kPa, float)
    places = np.asarray(stroke.sensors_mm, float)
    pressure = _resampled(pressure, 1, places, ROW_MM)
    if pressure.ndim > 2:
        across = (np.arange(pressure.shape[2]) - (pressure.shape[2] - 1) / 2) * (places[1] - places[0])
        pressure = _resampled(pressure, 2, across, COLUMN_MM)
    return pressure


def _resampled(pressure: Floats, axis: int, places: Floats, wanted: Floats) -> Floats:
    if len(places) == len(wanted) and np.allclose(places, wanted):
        return pressure
    pitch = places[1] - places[0]
    edges = np.append(places - pitch / 2, places[-1] + pitch / 2)
    force = np.insert(np.cumsum(pressure * pitch, axis=axis), 0, 0.0, axis=axis)
    ends = np.append(wanted - PITCH_MM / 2, wanted[-1] + PITCH_MM / 2)
    running = PchipInterpolator(edges, force, axis=axis)(np.clip(ends, edges[0], edges[-1]))
    return np.diff(running, axis=axis) / PITCH_MM
