"""Derivatives of a stroke by direct differentiation agree with strokes that differ in one number."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.sim.tissue import Case, Settings
from palpate.sim.tissue.any_tissue import any_tissue_cases
from palpate.sim.tissue.anywhere import anywhere_lumps
from palpate.sim.tissue.derivatives import differentiable, differentiate
from palpate.sim.tissue.errors import CaseError, StrokeError
from palpate.sim.tissue.frames import solve_frames
from palpate.sim.tissue.mesh import build_mesh
from palpate.sim.tissue.newton import Newton, NoConvergence
from palpate.sim.tissue.topology import OutsideTopology, Topology

FINE = Settings(tolerance=1e-9)
"""Newton's usual tolerance would be all that a difference shows, as would a factor in single precision."""
AGREE = 1e-3
STEP, PLACE_STEP_MM = 1e-5, 1e-6
"""Of one frame in hundreds a node enters the contact 1e-5 mm farther on."""


def frames_of(case, rng, n):
    """Places and forces of a hand that has pressed and then strokes, in no order."""
    places, share = rng.uniform(-32, 32, n), rng.uniform(0.85, 1.15, n)
    places[0], share[0] = places.min(), 0.4
    return places, case.F_N_per_m * share


def with_derivatives(case, places, forces, by, settings=None):
    """The frames, and how they change with these fields of the case."""
    settings = settings or Settings()
    topology = Topology(case, settings, min(places), max(places))
    frames = solve_frames(case, settings, topology.geometry(case), np.asarray(places), np.asarray(forces))
    return frames, differentiate(frames, topology, by)


def worst_difference(case, settings, fields, seed, n=4):
    """By parameter, how far derivatives are from differences of whole strokes, over the largest of them."""
    places, forces = frames_of(case, np.random.default_rng(seed), n)
    topology = Topology(case, settings, places.min() - 1, places.max() + 1)

    def felt(other, x=places, F=forces):
        found = solve_frames(
            other, settings, replace(topology.geometry(other), solver=topology.precise), x, F
        )
        return np.column_stack([found.images_kPa, found.displacement_mm])

    frames = solve_frames(case, settings, topology.geometry(case), places, forces)
    felt_now = np.column_stack([frames.images_kPa, frames.displacement_mm])
    found = differentiate(frames, topology, fields)
    out = {}
    for j, name in enumerate(found.by):
        derivative = np.column_stack([found.images[:, :, j], found.displacement[:, j]])
        if name == "place_mm":
            ends = felt(case, x=places - PLACE_STEP_MM), felt(case, x=places + PLACE_STEP_MM)
            step, value = 2 * PLACE_STEP_MM, 1.0
        elif name == "force_N_per_m":
            ends = felt(case, F=forces * (1 - STEP)), felt(case, F=forces * (1 + STEP))
            step, value = 2 * STEP * forces[:, None], case.F_N_per_m
        else:
            value = getattr(case, name)
            more = value * (1 + STEP) if value else STEP  # from nothing there is one side only
            less = value * (1 - STEP)
            ends = felt(replace(case, **{name: less})), felt(replace(case, **{name: more}))
            step = more - less
        difference = (ends[1] - ends[0]) / step
        for part, of in (("image", slice(0, 16)), ("displacement", slice(16, 17))):
            # what a face does not touch with does not count
            least = 1e-4 * np.abs(felt_now[:, of]).max() / (value or 1.0)
            scale = max(np.abs(difference[:, of]).max(), least)
            out[name, part] = np.abs(derivative - difference)[:, of].max() / scale
    return out


def random_cases(n, seed):
    """Lumps on the border and anywhere, plain tissue, and lumps that stiffen, in turn."""
    border, free = any_tissue_cases(n, seed)[::3], anywhere_lumps(n, seed)
    for k in range(n):
        if k % 4 == 0:
            yield border[k]
        elif k % 4 == 3:
            yield replace(free[k], lump_stiffening=20.0)
        elif k % 8 == 6:
            yield Case.without_lump(border[k].t_mm, border[k].F_rel, fat_stiffening=border[k].fat_stiffening)
        else:
            yield free[k]


def fields_of(case):
    """What this case can be differentiated by, but friction and padding, with no stroke on this side of 0."""
    return [name for name in differentiable(case) if name not in ("friction", "padding_mm_per_kPa")]


@pytest.mark.parametrize("number", [1])
def test_derivatives_are_those_of_whole_strokes(number):
    case = list(random_cases(4, 11))[number]
    assert max(worst_difference(case, FINE, fields_of(case), number, n=2).values()) < AGREE


def test_derivatives_by_a_muscle_are_those_of_whole_strokes():
    case = Case(10.0, 0.8, 10.0, 0.6, muscle_mm=9.0, muscle_ratio=3.0, muscle_stiffening=4.0)
    by = [name for name in differentiable(case) if name.startswith("muscle")]
    assert len(by) == 3
    assert max(worst_difference(case, FINE, by, 1).values()) < AGREE


@pytest.mark.long
@pytest.mark.parametrize("number", range(50))
def test_derivatives_of_fifty_random_cases(number):
    case = list(random_cases(50, 7))[number]
    settings = replace(FINE, hx_mm=(2.0, 1.0)[number % 2])
    assert max(worst_difference(case, settings, fields_of(case), number).values()) < AGREE


@pytest.mark.parametrize("number", [2, 3])
def test_derivatives_of_rows_that_are_read_up_to_the_contact_s_border(number):
    case = list(random_cases(4, 7))[number]
    by = ("d_mm", "h", "E_ratio", "gland_ratio", "probe_radius_mm")
    assert max(worst_difference(case, replace(FINE, to_border=True), by, number, n=2).values()) < AGREE


def test_friction_s_derivative_is_where_strokes_with_a_little_of_it_go():
    case = Case(10.0, 0.8, 10.0, 0.6)
    places = np.array([-20.0, -6.0, 0.0, 5.0])
    forces = np.full(4, case.F_N_per_m)
    frames, found = with_derivatives(case, places, forces, ["friction"], FINE)
    rubbed = replace(case, friction=1e-4)
    topology = Topology(rubbed, FINE, -20.0, 5.0)
    other = solve_frames(rubbed, FINE, topology.geometry(rubbed), places, forces)
    difference = (other.images_kPa - frames.images_kPa)[1:] / 1e-4
    assert np.abs(found.images[1:, :, 0] - difference).max() < 0.01 * np.abs(difference).max()


def test_frames_are_the_stroke_s_own():
    """In whatever order and under whatever forces: no frame depends on its neighbours."""
    case = anywhere_lumps(1, 3)[0]
    places, forces = frames_of(case, np.random.default_rng(1), 6)
    whole, _ = with_derivatives(case, places, forces, ["E_ratio"])
    for k in (0, 3):
        geometry = Topology(case, Settings(), places.min(), places.max()).geometry(case)
        alone = solve_frames(case, Settings(), geometry, places[k : k + 1], forces[k : k + 1])
        assert np.abs(alone.images_kPa[0] - whole.images_kPa[k]).max() < 2e-3
        assert abs(alone.displacement_mm[0] - whole.displacement_mm[k]) < 2e-4


def test_a_topology_begins_with_the_usual_mesh_and_moves_smoothly():
    for case in anywhere_lumps(12, 5):
        topology = Topology(case, Settings(), -40.0, 40.0)
        usual = build_mesh(case, Settings(), -40.0, 40.0)
        assert np.array_equal(topology.mesh(case).nodes_mm, usual.nodes_mm)
        nodes = [
            topology.mesh(replace(case, d_mm=case.d_mm * f, h=case.h / f)).nodes_mm
            for f in (1 - 1e-4, 1 - 5e-5, 1.0, 1 + 5e-5, 1 + 1e-4)
        ]
        jumps = np.abs(np.diff(nodes, axis=0)).max((1, 2))
        assert jumps.max() < 2 * 5e-5 * case.d_mm


def test_a_topology_says_where_it_ends():
    case = Case(10.0, 0.8, 10.0, 0.6, fat_mm=13.0)
    topology = Topology(case, Settings(), -40.0, 40.0)
    with pytest.raises(OutsideTopology, match="left the lump"):
        topology.mesh(replace(case, fat_mm=19.0))
    with pytest.raises(OutsideTopology, match="unlike"):
        topology.mesh(replace(case, d_mm=16.0, h=0.5))


@pytest.mark.parametrize(
    ("case", "by", "said"),
    [
        (Case(10.0, 0.8, 10.0), "colour", "no derivative by colour"),
        (Case(10.0, 0.8, 10.0), "fat_mm", "no thickness of its own"),
        (Case(10.0, 0.8, 1.0), "E_ratio", "without a lump"),
        (Case(10.0, 0.8, 10.0, friction=0.1), "d_mm", "with friction"),
    ],
)
def test_what_cannot_be_differentiated_is_said(case, by, said):
    with pytest.raises(CaseError, match=said):
        with_derivatives(case, [-4.0, 0.0], [50.0, 50.0], [by])


def test_an_equilibrium_that_is_not_stable_fails_as_a_stroke_does(monkeypatch):
    """One place in 800 strokes, a large lump 1.7 mm deep: the solver's own error ended `palpate refine`."""

    def linearise(*_):
        raise NoConvergence("the equilibrium is not stable")

    monkeypatch.setattr(Newton, "linearise", linearise)
    with pytest.raises(StrokeError, match="differentiating, the equilibrium is not stable"):
        with_derivatives(Case.from_code("d10h08e10f10"), [-3.0], [50.0], ("d_mm",))
