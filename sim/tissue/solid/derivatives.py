"""Derivatives of what a probe feels over a solid lump by everything that its case says.

Direct differentiation, as in the plane (`palpate.sim.tissue.derivatives`): at an equilibrium
R(u, lambda, Y; p) = 0 the tangent K, whole, is factored once, and K (u, lambda, Y)' = -dR/dp is solved for
all parameters together. dR/dp at fixed u is a difference of the assembly alone: on a mesh whose topology
stays, of other constants, or under another face. Solutions of the factor, which is in single precision, are
refined by the residual's own difference along them. Units: mm, kPa, mN.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue.case import Case
from palpate.sim.tissue.derivatives import MODULI, absent
from palpate.sim.tissue.errors import CaseError, StrokeError
from palpate.sim.tissue.face_sensors import ACROSS, SENSORS_MM, places_mm
from palpate.sim.tissue.layers import UNDER_FAT
from palpate.sim.tissue.newton import NoConvergence
from palpate.sim.tissue.one_thread import one_blas_thread
from palpate.sim.tissue.settings import Settings
from palpate.sim.tissue.solid.body import Body
from palpate.sim.tissue.solid.element import elasticity, integrate
from palpate.sim.tissue.solid.face import ACROSS_FIELDS, Touching
from palpate.sim.tissue.solid.result import SolidStroke
from palpate.sim.tissue.solid.run import SolidRun
from palpate.sim.tissue.solid.stroke import simulate_forces
from palpate.sim.tissue.solid.topology import SolidTopology
from palpate.sim.tissue.state import State

Floats = NDArray[np.float64]

LENGTHS = (
    "d_mm",
    "h",
    "half_across_mm",
    "half_down_mm",
    "offset_mm",
    *(f"{n}_mm" for n in UNDER_FAT),
    "fat_mm",
)
"""They move the mesh."""
FACE = (*ACROSS_FIELDS.values(), *ACROSS_FIELDS)
FIELDS = (*LENGTHS, *MODULI, *FACE)

_LENGTH_STEP = 5e-8
"""Relative, as in the plane: the bulk modulus magnifies its square."""
_MODULUS_STEP, _STIFFENING_STEP, _POISSON_STEP = 1e-3, 1e-5, 1e-6
"""Forces are linear in moduli, nearly so in b."""
_REFINEMENTS, _ALONG_MM = 1, 1e-6
_READ_MM = 1e-5
"""So far nodes are moved, and so many kPa more or less put on them, to see what the sensors read then."""


@dataclass(frozen=True)
class SolidDerivatives:
    """Derivatives by k parameters, each in its own unit, at n of a stroke's positions under one force.

    Attributes
    ----------
    by : tuple of str
        Fields of the case; the last two are "place_mm" and "force_N_per_m".
    images : ndarray (n, 16, 26, k)
        kPa per unit.
    displacement : ndarray (n, k)
        mm per unit.
    ramp_images, ramp_displacement : ndarray (r, 16, 26, k), (r, k)
        At the first position, under the forces of a press-in ramp.
    """

    by: tuple[str, ...]
    images: Floats
    displacement: Floats
    ramp_images: Floats
    ramp_displacement: Floats


def differentiable(case: Case) -> tuple[str, ...]:
    """All of `FIELDS` that a case has, and that do not break its symmetry."""
    without = absent(case)
    if case.shape != "ellipsoid":
        without |= {"half_across_mm", "half_down_mm"}
    if case.offset_mm == 0.0:
        without.add("offset_mm")
    return tuple(name for name in FIELDS if name not in without)


def strokes_with_derivatives(
    case: Case,
    forces: Sequence[float],
    settings: Settings | None = None,
    positions_mm: Sequence[float] | None = None,
    by: Sequence[str] | None = None,
    ramp: bool = False,
    at: int = 0,
    only: Sequence[int] | None = None,
) -> tuple[list[SolidStroke], SolidDerivatives]:
    """Strokes at rising forces, as `simulate_forces`, and the derivatives of one of them.

    Parameters
    ----------
    by : sequence of str, optional
        Fields of the case; all of `differentiable` by default.
    at : int
        Of the forces, the one whose stroke is differentiated.
    only : sequence of int, optional
        Of the positions, those where derivatives are taken; all by default.

    Raises
    ------
    CaseError
        Also where a field has no derivative.
    StrokeError
        As `simulate_forces`.
    """
    by = differentiable(case) if by is None else tuple(by)
    if unknown := [name for name in by if name not in differentiable(case)]:
        raise CaseError(f"{case.code}: there is no derivative by {unknown[0]}")
    if list(forces) != sorted(forces):
        raise CaseError("forces must rise")
    seen: list[tuple[SolidRun, float, list[State]]] = []
    strokes = simulate_forces(
        case, forces, settings, positions_mm, ramp, visit=lambda *what: seen.append(what)
    )
    run = seen[0][0]
    low = len(seen[0][2]) - len(forces)
    chosen = range(len(seen)) if only is None else only
    states = [(seen[i][1], seen[i][2][at if i else low + at]) for i in chosen]
    states += [(seen[0][1], state) for state in seen[0][2][:low]]
    with one_blas_thread():
        images, depth = _differentiated(run, states, by)
    n = len(chosen)
    return strokes, SolidDerivatives(
        (*by, "place_mm", "force_N_per_m"), images[:n], depth[:n], images[n:], depth[n:]
    )


def _differentiated(
    run: SolidRun, states: Sequence[tuple[float, State]], by: tuple[str, ...]
) -> tuple[Floats, Floats]:
    """Derivatives of images (n, 16, 26, k) and displacements (n, k) at states, each with its position."""
    k = len(by) + 2
    now = [run.newton.body.forces(state.u) for _, state in states]
    pushed, rise = _moved_forces(run, [state.u for _, state in states], now, by)
    images = np.empty((len(states), len(SENSORS_MM), ACROSS, k))
    depth = np.empty((len(states), k))
    for i, (x, state) in enumerate(states):
        try:
            touching = run.newton.linearise(state, x)
        except NoConvergence as error:
            raise StrokeError(run.case.code, x, f"differentiating, {error}") from None
        forces, gap, deficit = _sides(run, state, touching, x, by, rise)
        forces[: k - 2] += pushed[i]
        du, dY, dlam = _solved(run, state.u, now[i], touching, forces, gap, deficit)
        images[i] = _read(run, state, x, touching, du, dlam)
        depth[i] = rise - dY
    return images, depth


def _moved_forces(
    run: SolidRun, displacements: Sequence[Floats], now: Sequence[Floats], by: tuple[str, ...]
) -> tuple[NDArray[np.float32], Floats]:
    """Of the internal forces now, by all fields but the face's, (n, k, 3N); how the skin rises, (k + 2,)."""
    out = np.zeros((len(now), len(by), len(now[0])), np.float32)
    rise = np.zeros(len(by) + 2)
    lengths = SolidTopology(run.case, run.mesh.grid) if set(by) & set(LENGTHS) else None
    for j, name in enumerate(by):
        if name in FACE:
            continue
        other, step = _stepped(run.case, name)
        if name in LENGTHS:
            assert lengths is not None
            mesh = lengths.mesh(other)
            integrals = integrate(mesh)
            rise[j] = (other.centre_mm - run.case.centre_mm) / step
        else:
            mesh, integrals = run.mesh, run.newton.body.integrals
        body = Body(mesh, integrals, elasticity(other, mesh, integrals))
        for i, u in enumerate(displacements):
            out[i, j] = (body.forces(u) - now[i]) / step
    return out, rise


def _stepped(case: Case, name: str) -> tuple[Case, float]:
    """The case with a field a little larger, or smaller at the end of what it may be, and by how much."""
    value = getattr(case, name)
    for sign in (1.0, -1.0):
        if name.endswith("_stiffening"):
            step = sign * _STIFFENING_STEP
        elif name in MODULI:
            step = sign * (_POISSON_STEP if name == "poisson" else _MODULUS_STEP) * value
        else:
            step = sign * _LENGTH_STEP * max(abs(value), 1.0)
        try:
            return replace(case, **{name: value + step}), step
        except CaseError:
            if sign < 0:
                raise
    raise AssertionError


def _sides(
    run: SolidRun, state: State, touching: Touching, x: float, by: tuple[str, ...], rise: Floats
) -> tuple[Floats, Floats, Floats]:
    """d contact forces (k, 3N), d gap (k, active) and d force deficit (k,) at fixed u, lambda and height."""
    contact, active = run.contact, touching.active
    dofs, k = contact.dofs[active], len(by) + 2
    forces, gap, deficit = np.zeros((k, len(state.u))), np.zeros((k, len(active))), np.zeros(k)
    along = contact.x0[active] + state.u[dofs[:, 0]] - x
    across = contact.z0[active] + state.u[dofs[:, 2]]
    gap += rise[:, None]
    for j, name in enumerate(by):
        if name not in FACE:
            continue
        height, slopes = contact.shape.derivatives(along, across, name)
        gap[j] -= height
        forces[j][dofs[:, [0, 2]]] -= touching.force[:, None] * slopes
    gap[-2] = -touching.normal[:, 0]
    forces[-2, dofs[:, 0]] += touching.force * touching.curvature[:, 0]
    deficit[-1] = run.force(run.case.F_rel) / run.case.F_N_per_m
    return forces, gap, deficit


def _solved(
    run: SolidRun,
    u: Floats,
    now: Floats,
    touching: Touching,
    forces: Floats,
    gap: Floats,
    deficit: Floats,
) -> tuple[Floats, Floats, Floats]:
    """d u (k, 3N), d height (k,) and d lambda (k, active): a step of Newton's method, and its refinements."""
    contact, newton = run.contact, run.newton
    held = np.nonzero(run.mesh.fixed.ravel())[0]
    r, w, normal = contact.augmentation, contact.weight[touching.active], touching.normal
    dofs = contact.dofs[touching.active]
    bend = np.maximum(touching.force, 0.0)[:, None] * touching.curvature
    border = np.zeros(forces.shape[1])
    border[dofs] = -(w * r)[:, None] * normal
    border[held] = 0.0
    of_height = newton.solver.solve(border[None])[0]
    pivot = r * w.sum() - border @ of_height

    def step(forces: Floats, gap: Floats, deficit: Floats) -> tuple[Floats, Floats, Floats]:
        pull = r * gap
        sides = -forces
        sides[:, dofs] -= (w * pull)[..., None] * normal
        sides[:, held] = 0.0
        change = newton.solver.solve(sides)
        rise = (pull @ w - deficit - change @ border) / pivot
        du = change - rise[:, None] * of_height
        return du, rise, pull + r * ((du[:, dofs] * normal).sum(-1) - rise[:, None])

    du, rise, dlam = step(forces, gap, deficit)
    for _ in range(_REFINEMENTS):
        left = forces + np.array([_along(newton.body, u, one, now) for one in du])
        moved = du[:, dofs]
        push = (w * dlam)[..., None] * normal
        push[..., 0] -= bend[:, 0] * moved[..., 0]
        push[..., 2] -= bend[:, 1] * moved[..., 2]
        left[:, dofs] += push
        apart = gap + (moved * normal).sum(-1) - rise[:, None]
        more = step(left, apart, deficit - dlam @ w)
        du, rise, dlam = du + more[0], rise + more[1], dlam + more[2]
    return du, rise, dlam


def _along(body: Body, u: Floats, direction: Floats, now: Floats) -> Floats:
    """How internal forces change along a direction (3N,)."""
    step = _ALONG_MM / max(float(np.abs(direction).max()), 1e-12)
    change: Floats = (body.forces(u + step * direction) - now) / step
    return change


def _read(run: SolidRun, state: State, x: float, touching: Touching, du: Floats, dlam: Floats) -> Floats:
    """Derivatives (16, 26, k) of the image; the second last parameter carries the sensors along."""
    half, across = run.mesh.grid.half, places_mm(ACROSS)
    before = run.contact.pressure(state.u, state.multiplier).read(x, SENSORS_MM, across, half)
    out = np.empty((*before.shape, len(du)))
    for j, (moved, pressed) in enumerate(zip(du, dlam)):
        far = max(float(np.abs(moved[run.contact.dofs]).max()), float(np.abs(pressed).max()))
        step = _READ_MM / max(far, float(j == len(du) - 2), 1e-12)
        multiplier = state.multiplier.copy()
        # a node on the point of touching would move the contact's border by a node
        multiplier[touching.active] += np.where(
            multiplier[touching.active] > step * np.abs(pressed), step * pressed, 0.0
        )
        skin = run.contact.pressure(state.u + step * moved, multiplier)
        place = x + step * (j == len(du) - 2)
        out[..., j] = (skin.read(place, SENSORS_MM, across, half) - before) / step
    return out
