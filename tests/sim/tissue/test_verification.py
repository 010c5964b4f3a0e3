"""The finite elements are right: known answers, invariance, no locking (derivatives are in test_forms.py)."""

import functools
import math

import numpy as np
import pytest

from palpate.sim.tissue import SENSORS_MM, Case, Settings, simulate
from palpate.sim.tissue.probe_shape import ProbeShape
from palpate.sim.tissue.solver.choice import make_solver
from tests.sim.tissue.blocks import block, press, tissue_of

FLAT = ProbeShape(math.inf, 1e6, 1.0)


def shaken(seed=1):
    return block([-10, -7, -5.5, -2, 0.5, 3, 5, 10], [-8, -5, -2.4, -1, 0], shake=0.3, seed=seed)


def graded(start, stop, first, ratio):
    steps = [start]
    while abs(steps[-1]) < abs(stop):
        steps.append(steps[-1] + np.sign(stop) * first)
        first *= ratio
    steps = np.array(steps)
    return start + (steps - start) * (stop - start) / (steps[-1] - start)


@pytest.mark.parametrize("nu", [0.3, 0.45, 0.495])
def test_a_flat_probe_on_a_distorted_mesh_presses_evenly(nu):
    tissue = tissue_of(shaken(), nu=nu)
    # A small augmentation: a large one would round off the digits that are looked at here.
    _, pressure, _ = press(tissue, FLAT, force=40.0, depth=0.05, tolerance=1e-10, augmentation=1e3)
    np.testing.assert_allclose(pressure, 2.0, rtol=1e-12)


@pytest.mark.parametrize("nu", [0.3, 0.4999])
def test_hertz_line_contact_converges_to_the_exact_pressure(nu):
    radius, young, a = 400.0, 10.0, 8.0
    plane = young / (1 - nu**2)
    force = math.pi * a * a * plane / 4 / radius
    peak = 2 * force / math.pi / a
    errors = []
    for hx in (2.0, 1.0, 0.5):
        side = graded(12.0, 200.0, 1.3 * hx, 1.5)
        x = np.concatenate([-side[::-1], np.arange(-12.0, 12.0 + 1e-9, hx)[1:-1], side])
        y = graded(0.0, -400.0, 0.8 * hx, 1.45)[::-1]
        places, pressure, _ = press(
            tissue_of(block(x, y), young, nu), ProbeShape(radius, 1e6, 1.0), force, 0.3
        )
        exact = peak * np.sqrt(np.maximum(1 - (places / a) ** 2, 0))
        inside = np.abs(places) < 0.9 * a
        errors.append(np.sqrt(np.mean((pressure - exact)[inside] ** 2)) / peak)
        if hx == 1.0:  # hx / a = 0.125
            assert np.interp(0.0, places, pressure) == pytest.approx(peak, rel=2e-3)
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 0.002


def random_state(tissue, size=0.15, seed=2):
    rng = np.random.default_rng(seed)
    return rng.normal(0, size, 2 * len(tissue.mesh.nodes_mm))


def forces(tissue, u):
    m = len(tissue.mesh.elements)
    return tissue.residual(u, np.zeros((m, 3)), np.zeros((m, 3, 18)))[0]


@pytest.mark.parametrize("stiffening", [0.0, 5.0])
def test_rigid_motion_costs_nothing_and_rotation_turns_the_forces(stiffening):
    tissue = tissue_of(shaken(), stiffening=stiffening)
    x = tissue.mesh.nodes_mm
    angle = 0.7
    Q = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    rigid = (x @ Q.T + [3.0, -2.0] - x).ravel()
    u = random_state(tissue, 0.05)
    force = forces(tissue, u).reshape(-1, 2)
    assert np.abs(forces(tissue, rigid)).max() < 1e-10 * np.abs(force).max()
    turned = ((x + u.reshape(-1, 2)) @ Q.T - x).ravel()
    np.testing.assert_allclose(
        forces(tissue, turned).reshape(-1, 2), force @ Q.T, atol=1e-9 * np.abs(force).max()
    )


def test_the_solvers_agree():
    tissue = tissue_of(shaken())
    m = len(tissue.mesh.elements)
    K, frozen = np.empty((m, 18, 18)), np.empty((m, 3, 18))
    tissue.tangent(random_state(tissue, 0.02), np.zeros((m, 3)), np.arange(m), K, frozen)
    contact = np.zeros((len(tissue.mesh.surface), 3))
    contact[4:9] = [10.0, 3.0, 1e6]
    B = np.random.default_rng(5).normal(size=(2, 2 * len(tissue.mesh.nodes_mm)))
    solutions = []
    for name, precise in (("strip", True), ("cholmod", True), ("superlu", True), ("strip", False)):
        solver = make_solver(name, tissue.mesh, precise)
        solver.change(0.9 * K, np.arange(m))
        solver.factor(contact, 3.0)
        solver.change(K, np.arange(m // 2))  # half is changed, the rest found again
        solver.change(K, np.arange(m // 2, m))
        solver.factor(contact, -3.0)
        solutions.append(solver.solve(B))
    for other, digits in zip(solutions[1:], (9, 9, 4), strict=True):
        np.testing.assert_allclose(other, solutions[0], atol=10.0**-digits * np.abs(solutions[0]).max())


@pytest.mark.parametrize("solver", ["cholmod", "superlu"])
def test_a_stroke_does_not_depend_on_the_solver(solver):
    case = Case.from_code("d10h08e10f10")
    ours = simulate(case, positions_mm=[-6, -4, -2, 0])
    other = simulate(case, Settings(solver=solver), positions_mm=[-6, -4, -2, 0])
    np.testing.assert_allclose(other.images_kPa, ours.images_kPa, rtol=1e-4)
    np.testing.assert_allclose(other.displacement_mm, ours.displacement_mm, rtol=1e-5)


def error_in_pressure(poisson, settings, sensors):
    """Rms difference from a mesh twice as fine over `sensors`, of the peak, far from the lump and over it."""
    case, places = Case(10, 0.8, 10, poisson=poisson), [-28, 0]
    fine = finer(poisson)
    stroke = simulate(case, settings, positions_mm=places)
    np.testing.assert_allclose(stroke.displacement_mm, fine.displacement_mm, rtol=2e-3)
    difference = (stroke.images_kPa - fine.images_kPa)[:, sensors] / fine.peak_kPa[:, None]
    return np.sqrt(np.mean(difference**2, axis=1))


@functools.cache
def finer(poisson):
    return simulate(Case(10, 0.8, 10, poisson=poisson), Settings().refined(2), positions_mm=[-28, 0])


def test_nearly_incompressible_tissue_does_not_lock():
    everywhere, inner = slice(None), np.abs(SENSORS_MM) < 11.0
    assert (error_in_pressure(0.4999, Settings(), inner) < 0.005).all()
    assert (error_in_pressure(0.4999, Settings(hx_mm=1.0), everywhere) < 0.005).all()
    # At hx = 2 the outermost sensors feel the contact's edge come in steps of 1 mm: .8 %, at any nu.
    coarse = error_in_pressure(0.4999, Settings(), everywhere)
    assert (coarse < 0.01).all()
    assert (coarse < 1.3 * error_in_pressure(0.49, Settings(), everywhere)).all()
