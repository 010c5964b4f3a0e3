"""Derivatives of what frames feel by everything that a case says, by direct differentiation.

An equilibrium is R(u, lambda, Y; p) = 0, with displacement u, contact multipliers lambda and the probe's
height Y. Differentiated by a parameter p at the equilibrium it reads K (u, lambda, Y)' = -dR/dp: one
factorisation of the tangent K, and one right-hand side for each parameter. The active nodes of the contact
stay active, as they do in a step of Newton's method.

dR/dp at fixed u is exact for moduli, in which R is linear, and for the face. For lengths, which move the
nodes of the mesh, it is a difference of the assembly alone, on a mesh whose topology stays.
Units: mm, kPa, N/m.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue.case import Case
from palpate.sim.tissue.contact import ContactState
from palpate.sim.tissue.element import integrate
from palpate.sim.tissue.errors import CaseError, StrokeError
from palpate.sim.tissue.frames import SolvedFrames
from palpate.sim.tissue.layers import DEEPER, UNDER_FAT, fields_of
from palpate.sim.tissue.material import Stiffening, Tissue, elasticity
from palpate.sim.tissue.newton import Newton, NoConvergence
from palpate.sim.tissue.one_thread import one_blas_thread
from palpate.sim.tissue.run import StrokeRun
from palpate.sim.tissue.state import State
from palpate.sim.tissue.topology import OutsideTopology, Topology

Floats = NDArray[np.float64]

LENGTHS = ("d_mm", "h", *(f"{layer}_mm" for layer in UNDER_FAT), "fat_mm")
"""They move the mesh."""
MODULI = (
    "E_ratio",
    *(f"{layer}_ratio" for layer in UNDER_FAT),
    "fat_kPa",
    "poisson",
    *(f"{tissue}_stiffening" for tissue in ("fat", *UNDER_FAT, "lump")),
)
FACE = ("probe_radius_mm", "face_half_mm", "fillet_per_mm2", "friction", "padding_mm_per_kPa")
FIELDS = (*LENGTHS, *MODULI, *FACE)
"""Fields of a case in the plane; friction from none at all only. The force is the frames' own."""

_LENGTH_STEP = 2e-8
"""Relative. Small: the bulk modulus magnifies its square a hundredfold."""
_MODULUS_STEP = 1e-6
_STIFFENING_STEP = 1e-3


@dataclass(frozen=True)
class Derivatives:
    """Derivatives of n frames by k parameters, each in its own unit.

    Attributes
    ----------
    by : tuple of str
        Fields of the case; the last two are "place_mm" and "force_N_per_m" of the frame itself.
    images : ndarray (n, rows, k)
        kPa per unit.
    displacement : ndarray (n, k)
        mm per unit.
    steps : list of (ndarray, ndarray, ndarray)
        For each frame d u (k, 2N), d lambda (k, S) and d Y (k,).
    """

    by: tuple[str, ...]
    images: Floats
    displacement: Floats
    steps: list[tuple[NDArray[np.float32], Floats, Floats]]

    def carried(self, frames: SolvedFrames, changes: Floats) -> list[State]:
        """The frames' states after changes (n, k) of the parameters, to first order."""
        out = []
        for state, (du, dlam, dY), change in zip(frames.states, self.steps, changes):
            free = np.maximum(state.multiplier + change @ dlam, 0.0)
            multiplier = np.where(state.multiplier > 0, free, 0.0)
            u = state.u + change.astype(np.float32) @ du
            out.append(State(u, state.height + float(change @ dY), multiplier, state.pressure))
        return out


def absent(case: Case) -> set[str]:
    """Fields that mean nothing in a case: of layers that it has not, and of a lump where there is none."""
    without = {"fat_mm"} if case.fat_mm is None else set()
    for layer in DEEPER:
        if getattr(case, f"{layer}_mm") is None:
            without |= set(fields_of(layer))
    return without if case.has_lump else without | {"E_ratio", "lump_stiffening"}


def differentiable(case: Case) -> tuple[str, ...]:
    """All of `FIELDS` that a case has."""
    without = absent(case) if case.has_lump else absent(case) | {"d_mm"}
    return tuple(name for name in FIELDS if name not in without)


def differentiate(frames: SolvedFrames, topology: Topology, by: Sequence[str] | None = None) -> Derivatives:
    """Derivatives at frames that were solved on a geometry of this topology; otherwise as above."""
    run = frames.run
    by = differentiable(run.case) if by is None else by
    if unknown := [name for name in by if name not in FIELDS]:
        raise CaseError(f"there is no derivative by {unknown[0]}; there are {', '.join(FIELDS)}")
    if run.case.friction:
        raise CaseError(f"{run.case.code}: with friction a stroke's derivatives are not worked out")
    if not isinstance(run.newton, Newton):
        raise CaseError("derivatives take the compiled solver, not the reference")
    columns = _Columns(run, topology, tuple(by), frames.sensors)
    n, k = len(frames.states), len(by) + 2
    images, depth = np.empty((n, frames.images_kPa.shape[1], k)), np.empty((n, k))
    steps: list[tuple[NDArray[np.float32], Floats, Floats]] = [(np.empty(0, np.float32),) * 3] * n  # type: ignore[list-item]
    with one_blas_thread():
        for i in frames.order.tolist():
            x = float(frames.places_mm[i])
            try:
                images[i], depth[i], steps[i] = columns.at(frames.states[i], x)
            except NoConvergence as error:
                raise StrokeError(run.case.code, x, f"differentiating, {error}") from None
    return Derivatives((*by, "place_mm", "force_N_per_m"), images, depth, steps)


@dataclass(frozen=True)
class _Moved:
    """The tissue with one length a little larger, and how its surface rises with it."""

    tissue: Tissue
    step: float
    rise: float


class _Columns:
    """Right-hand sides by `by`, then place and force."""

    def __init__(self, run: StrokeRun, topology: Topology, by: tuple[str, ...], sensors: Floats) -> None:
        assert isinstance(run.newton, Newton)
        self._run, self._by, self._sensors = run, by, sensors
        self._newton = Newton(run.tissue, run.contact, topology.precise, run.newton.tolerance)
        self._held = np.nonzero(run.mesh.fixed.ravel())[0]
        self._zero = np.zeros((len(run.mesh.elements), 3))
        self._frozen = np.zeros((len(run.mesh.elements), 3, 18))
        self._moved = {j: self._longer(topology, name) for j, name in enumerate(by) if name in LENGTHS}
        self._linear = {
            j: self._alone(*slopes)
            for j, name in enumerate(by)
            if name in MODULI and (slopes := self._slopes(name)) is not None
        }
        self._stiffer = {
            j: self._stiffened(name) for j, name in enumerate(by) if name in MODULI and j not in self._linear
        }
        self._rise = np.zeros(len(by) + 2)
        for j, moved in self._moved.items():
            self._rise[j] = moved.rise

    def _longer(self, topology: Topology, name: str) -> _Moved:
        case = self._run.case
        value = getattr(case, name)
        if value is None:
            what = "its fat has no thickness" if name == "fat_mm" else f"it has no {name}"
            raise CaseError(f"{case.code}: {what} of its own to differentiate by")
        for sign in (1.0, -1.0):  # at the end of what the topology or the case allows, the other way
            step = sign * _LENGTH_STEP * value
            try:
                other: Case = replace(case, **{name: value + step})
                mesh = topology.mesh(other)
            except (OutsideTopology, CaseError):
                if sign < 0:
                    raise
                continue
            break
        tissue = Tissue(mesh, integrate(mesh), self._run.tissue.constants)
        return _Moved(tissue, step, (mesh.border_mm + other.t_mm - self._run.surface_mm) / step)

    def _slopes(self, name: str) -> tuple[Floats, Floats] | None:
        """d mu and d bulk (M,) by a modulus; None for a stiffening, in which the forces are not linear."""
        case = self._run.case
        if name.endswith("_stiffening"):
            return None
        if name == "E_ratio" and not case.has_lump:
            raise CaseError("without a lump there is no derivative by its stiffness")
        value = getattr(case, name)
        step = _MODULUS_STEP * value
        less, more = (
            elasticity(replace(case, **{name: v}), self._run.mesh) for v in (value - step, value + step)
        )
        return (more.mu - less.mu) / (2 * step), (more.bulk - less.bulk) / (2 * step)

    def _alone(self, mu: Floats, bulk: Floats) -> Tissue:
        """Tissue of these moduli; of no stiffness where they are 0."""
        own = self._run.tissue
        return Tissue(own.mesh, own.integrals, replace(own.constants, mu=mu, bulk=bulk))

    def _stiffened(self, name: str) -> Stiffening:
        """The elements that stiffen more with it."""
        run, case = self._run, self._run.case
        b = run.tissue.constants.stiffening
        # from a b that is not 0, so that a law that is linear counts too
        marked = elasticity(replace(case, **{name: getattr(case, name) + 1.0}), run.mesh).stiffening
        which = np.nonzero(marked - b > 0.5)[0]
        return Stiffening(run.mesh, run.tissue.integrals, run.tissue.constants, which)

    def at(self, state: State, x: float) -> tuple[Floats, Floats, tuple[NDArray[np.float32], Floats, Floats]]:
        """Derivatives of the image (rows, k), the displacement (k,) and the state."""
        contact = self._run.contact
        touching = self._newton.linearise(state, x)
        forces, gap, deficit = self._sides(state, touching, x)
        du, rise, dlam = self._solved(forces, gap, deficit, touching)
        multipliers = np.zeros((len(du), len(contact.x0)))
        multipliers[:, touching.active] = dlam
        places, pressures, _ = contact.pressure(state.u, state.multiplier, x)
        dx, dp = contact.pressure_derivatives(state.u, state.multiplier, du, multipliers)
        dx[-2] -= 1.0  # the frame's own place carries its sensors along
        images = self._run.reading.differentiate(places - x, pressures, dx, dp, self._sensors)
        return images.T, self._rise - rise, (du.astype(np.float32), multipliers, rise)

    def _sides(self, state: State, touching: ContactState, x: float) -> tuple[Floats, Floats, Floats]:
        """d forces (k, 2N), d gap (k, active) and d force deficit (k,) at fixed u, lambda and height."""
        run, contact, u = self._run, self._run.contact, state.u
        active = touching.active
        dof = contact.x_dof[active]
        k = len(self._by) + 2
        forces, gap, deficit = np.zeros((k, len(u))), np.zeros((k, len(active))), np.zeros(k)
        if self._moved:
            base = self._internal(run.tissue, u)
        for j, moved in self._moved.items():
            forces[j] = (self._internal(moved.tissue, u) - base) / moved.step
            gap[j] = moved.rise
        for j, tissue in self._linear.items():
            forces[j] = self._internal(tissue, u)
        for j, stiffening in self._stiffer.items():
            forces[j] = _of_stiffening(stiffening, u)
        s = contact.x0[active] + u[dof] - x
        for j, name in enumerate(self._by):
            if name not in FACE:
                continue
            if name == "friction":
                forces[j, dof] -= touching.force
                forces[j, dof + 1] -= touching.force * touching.slope
                deficit[j] = float(touching.force @ touching.slope)
                continue
            if name == "padding_mm_per_kPa":
                gap[j] = -state.multiplier[active]
                continue
            height, slope = contact.shape.derivatives(s, name)
            gap[j] = -height
            forces[j, dof] -= touching.force * slope
        gap[-2] = touching.slope
        forces[-2, dof] += touching.force * touching.curvature
        deficit[-1] = 1.0
        forces[:, self._held] = 0.0
        return forces, gap, deficit

    def _internal(self, tissue: Tissue, u: Floats) -> Floats:
        """What the tissue's elements push back with, (2N,)."""
        return tissue.residual(u, self._zero, self._frozen)[0]

    def _solved(
        self, forces: Floats, gap: Floats, deficit: Floats, touching: ContactState
    ) -> tuple[Floats, Floats, Floats]:
        """d u (k, 2N), d height (k,) and d lambda (k, active), as a step of Newton's method has them."""
        contact = self._run.contact
        r, w, slope = contact.augmentation, contact.weight[touching.active], touching.slope
        dof = contact.x_dof[touching.active]
        pull = r * gap
        sides = np.zeros((len(forces) + 1, forces.shape[1]))
        np.negative(forces, out=sides[:-1])
        sides[:-1, dof] += w * pull * slope
        sides[:-1, dof + 1] -= w * pull
        sides[-1, dof] = w * r * slope
        sides[-1, dof + 1] = -w * r
        border = sides[-1].copy()
        solved = self._newton.solver.solve(sides)
        change, of_height = solved[:-1], solved[-1]
        rise = (pull @ w - deficit - change @ border) / (r * w.sum() - border @ of_height)
        du = change - rise[:, None] * of_height
        return du, rise, pull + r * (du[:, dof + 1] - slope * du[:, dof] - rise[:, None])


def _of_stiffening(stiffening: Stiffening, u: Floats) -> Floats:
    """How forces (2N,) change with b."""
    out = np.zeros((2, len(u)))
    for side, more in zip(out, (0.0, _STIFFENING_STEP)):
        stiffening.residual(u, side, more)
    return (out[1] - out[0]) / _STIFFENING_STEP
