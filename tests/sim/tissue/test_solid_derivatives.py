"""Derivatives of a stroke over a solid lump agree with strokes that differ in one number."""

import math
from dataclasses import replace

import numpy as np
import pytest

from palpate.sim.tissue import Case, Settings
from palpate.sim.tissue.errors import CaseError
from palpate.sim.tissue.solid.derivatives import differentiable, strokes_with_derivatives
from palpate.sim.tissue.solid.design import ball_cases
from palpate.sim.tissue.solid.element import integrate
from palpate.sim.tissue.solid.grid import lay_grid
from palpate.sim.tissue.solid.run import SolidGeometry, SolidRun, set_up
from palpate.sim.tissue.solid.stroke import simulate_forces
from palpate.sim.tissue.solid.topology import SolidTopology

PLACES = [-8.13, -4.37]
"""Where no sensor's parts begin at a node, at which what it reads has two slopes."""
AGREE, AT_KINKS = 3e-3, 2e-2
"""What sensors read has kinks where their parts pass a node, as steps of the place do."""
HARDLY = "E_ratio", "half_across_mm", "gland_mm", "face_half_mm", "fat_stiffening", "gland_stiffening"
STEPS = dict.fromkeys(HARDLY, 1e-3)
STEPS |= {"fillet_per_mm2": 5e-3, "across_fillet_per_mm2": 2e-4}
"""Relative. Smaller ones are lost in Newton's tolerance where they hardly matter; of the rest, 1e-4, larger
ones bring nodes into contact."""
NEARER = 1.0, 0.1
"""A step that bends what is read at the contact's border is taken again, smaller."""
BALL = Case(12.0, 0.6, 8.0, 0.4, shape="ball", fat_stiffening=1.0, gland_stiffening=0.5)
BESIDE = Case(
    13.0, 0.5, 12.0, 0.4, shape="ellipsoid", half_across_mm=5.0, half_down_mm=4.0, offset_mm=5.0,
    fat_stiffening=1.0, gland_stiffening=0.5,
)  # fmt: skip


def worst_difference(case, settings, by):
    """By parameter, how far derivatives are from differences of equilibria, over the largest of them."""
    _, found = strokes_with_derivatives(case, [case.F_rel], settings, PLACES, by)
    states = []
    simulate_forces(case, [case.F_rel], settings, PLACES, visit=lambda run, x, seen: states.append(seen[-1]))
    grid = lay_grid(case, settings, PLACES[0], PLACES[-1])
    fronts, topology = set_up(grid).fronts, SolidTopology(case, grid)

    def felt(other, i, moved=0.0):
        mesh = topology.mesh(other)
        share = 0.5 if grid.half else 1.0
        run = SolidRun(other, settings, SolidGeometry(mesh, integrate(mesh), fronts), share, np.array(PLACES))
        begin, x = states[i].copy(), PLACES[i] + moved
        begin.height += other.centre_mm - case.centre_mm
        force = run.force(other.F_rel)
        state = run.newton.solve(begin, x, force, careful=True)
        row = run.read(state, x, force)
        return np.append(row["images_kPa"], row["displacement_mm"]), state.multiplier > 0

    def stepped(name, i, nearer):
        of = "F_rel" if name == "force_N_per_m" else name
        if name == "place_mm":
            step = nearer * 2e-5
            return 1.0, step, [felt(case, i, side * step) for side in (-1, 1)]
        value = getattr(case, of)
        step = nearer * STEPS.get(of, 1e-4) * value
        ends = [felt(replace(case, **{of: value + side * step}), i) for side in (-1, 1)]
        unit = 100.0 if of == "F_rel" else 1.0
        return unit * value, unit * step, ends

    out = {}
    for i in range(len(PLACES)):
        now, touching = felt(case, i)
        for j, name in enumerate(found.by):
            derivative = np.append(found.images[i, ..., j], found.displacement[i, j])
            for nearer in NEARER:
                value, step, ends = stepped(name, i, nearer)
                if any((touches != touching).any() for _, touches in ends):
                    continue  # a node comes into contact, or leaves it: there are two slopes
                difference = (ends[1][0] - ends[0][0]) / (2 * step)
                beyond = np.abs(derivative - difference)
                if nearer < 1:
                    # where a smaller step leaves two slopes there is a kink: the derivative is one of them
                    low, high = np.sort([(now - ends[0][0]) / step, (ends[1][0] - now) / step], axis=0)
                    beyond = np.abs(derivative - np.clip(derivative, low, high))
                apart = 0.0
                for part in (slice(0, -1), slice(-1, None)):
                    # what hardly matters is lost in the equilibrium's own digits
                    scale = max(np.abs(difference[part]).max(), 1e-3 * np.abs(now[part]).max() / value)
                    apart = max(apart, beyond[part].max() / scale)
                out[name, i] = min(out.get((name, i), np.inf), apart)
                if apart < AGREE:
                    break
    return out


def check(found, asked):
    assert len(found) > 0.8 * len(PLACES) * (asked + 2)
    for (name, place), apart in found.items():
        assert apart < (AT_KINKS if name in ("place_mm", "poisson") else AGREE), (name, place, apart)


def test_derivatives_over_a_ball_are_those_of_whole_strokes():
    by = ("d_mm", "E_ratio", "fat_stiffening", "probe_radius_mm")
    found = worst_difference(BALL, Settings(hx_mm=4.0, tolerance=1e-10), by)
    check(found, len(by))


@pytest.mark.long
@pytest.mark.parametrize("case", [BALL, BESIDE, *ball_cases(8, 5)[1::3]])
def test_derivatives_of_solid_lumps_of_all_kinds(case):
    by = [name for name in differentiable(case) if getattr(case, name)]
    found = worst_difference(case, Settings(tolerance=1e-10), by)
    check(found, len(by))


def test_derivatives_of_several_strokes_are_of_the_one_and_the_places_asked_for_and_of_the_ramp():
    settings = Settings(hx_mm=3.0)
    alone = strokes_with_derivatives(BALL, [0.4], settings, PLACES, ["E_ratio"])
    others = strokes_with_derivatives(
        BALL, [0.34, 0.4], settings, PLACES, ["E_ratio"], ramp=True, at=1, only=[1]
    )
    assert [len(stroke.images_kPa) for stroke in others[0]] == [len(PLACES)] * 2
    assert others[1].images == pytest.approx(alone[1].images[[1]], abs=3e-4)
    assert others[1].ramp_images.shape == (2, 16, 26, 3)
    assert np.isfinite(others[1].ramp_images).all()


def test_a_field_that_has_no_derivative_is_refused_and_so_are_forces_that_fall():
    with pytest.raises(CaseError, match="no derivative by friction"):
        strokes_with_derivatives(BALL, [0.4], by=["friction"])
    with pytest.raises(CaseError, match="no derivative by offset_mm"):
        strokes_with_derivatives(BALL, [0.4], by=["offset_mm"])
    with pytest.raises(CaseError, match="rise"):
        strokes_with_derivatives(BALL, [0.4, 0.3], by=["d_mm"])


def test_lengths_have_no_derivatives_where_the_border_cuts_elements():
    case = replace(BALL, fat_mm=BALL.depth_mm + 0.05 * BALL.d_mm)
    with pytest.raises(CaseError, match="cuts elements"):
        strokes_with_derivatives(case, [0.4], Settings(hx_mm=4.0), PLACES, ["d_mm"])


def test_a_flat_face_has_derivatives_too():
    """By its radius, which has no end, they were no numbers."""
    flat = replace(BALL, probe_radius_mm=math.inf)
    _, found = strokes_with_derivatives(flat, [0.4], Settings(hx_mm=4.0), PLACES[1:], ["probe_radius_mm"])
    assert not found.images[..., 0].any()
    assert np.isfinite(found.images).all()


@pytest.mark.long
def test_a_node_on_the_point_of_touching_has_no_derivative_of_its_own():
    """One in sixteen corrections of inverted balls had slopes a thousand times too large: of one node."""
    settings, place = Settings(hx_mm=3.0, layer_mm=4.0), [-28.0]

    def touching(F):
        seen = []
        simulate_forces(
            replace(BALL, F_rel=F), [F], settings, place, visit=lambda *what: seen.append(what[2])
        )
        return np.count_nonzero(seen[0][-1].multiplier > 0)

    def largest(F):
        _, found = strokes_with_derivatives(replace(BALL, F_rel=F), [F], settings, place, ["fat_stiffening"])
        return np.abs(found.images).max((0, 1, 2))

    low, high = 0.43, 0.438
    before = touching(low)
    assert touching(high) > before
    for _ in range(16):
        middle = (low + high) / 2
        low, high = (middle, high) if touching(middle) == before else (low, middle)
    assert largest(low) == pytest.approx(largest(low - 1e-4), rel=0.02)
