"""What the thesis saw in its simulations, and what a probe's designer asks next, holds here."""

import functools
from dataclasses import replace

import numpy as np
import pytest

from palpate.features.map_features import tactile_map
from palpate.sim.tissue import Case, Settings, Stroke, load_curve, simulate, simulate_forces
from tests.sim.tissue.felt import stiffness_felt

FORCES = (0.2, 0.4, 0.6, 0.8, 1.0)
REFERENCE = Case.from_code("d10h08e10f10")


@functools.cache
def run(code: str) -> Stroke:
    return simulate(Case.from_code(code))


def of_stiffness(E: float) -> Stroke:
    return run(replace(REFERENCE, E_ratio=E).code)


def height_of_bump(stroke: Stroke) -> float:
    """Mean trace over the lump less that far from it, kPa: what becomes the map's amplitude."""
    middle = stroke.images_kPa[:, 5:11].mean(1)
    return float(middle[-1] - middle[0])


def power_law(force, strain):
    """Exponent and R2 of force = A strain^B."""
    x, y = np.log(strain), np.log(force)
    slope, level = np.polyfit(x, y, 1)
    residual = y - slope * x - level
    return slope, 1 - residual.var() / y.var()


@functools.cache
def strain_over_lump(E: float) -> np.ndarray:
    return np.array([s.strain[0] for s in load_curve(replace(REFERENCE, E_ratio=E), FORCES)])


def test_displacement_far_from_the_lump_does_not_know_its_stiffness():
    far = [of_stiffness(E).displacement_mm[0] for E in (2.0, 5.0, 10.0, 50.0, 1000.0)]
    assert np.ptp(far) < 0.02 * np.mean(far)


def test_pressure_far_from_the_lump_is_proportional_to_force():
    strokes = simulate_forces(REFERENCE, FORCES, positions_mm=[-28])
    base = np.array([s.images_kPa[0].mean() for s in strokes])
    slope = base @ FORCES / np.dot(FORCES, FORCES)
    np.testing.assert_allclose(base, slope * np.array(FORCES), rtol=0.03)


def test_the_bump_is_linear_in_stiffness_to_minus_two_thirds():
    E = np.array([2.0, 5.0, 10.0, 50.0, 1000.0])
    bump = np.array([height_of_bump(of_stiffness(e)) for e in E])
    x = E ** (-2 / 3)
    assert np.corrcoef(x, bump)[0, 1] ** 2 > 0.99
    assert (np.diff(bump) > 0).all()


def test_without_a_lump_there_is_no_bump():
    stroke = of_stiffness(1.0)
    base = stroke.images_kPa.mean()
    _, pressure = tactile_map(stroke)
    assert np.ptp(pressure) < 1e-4 * base
    assert abs(height_of_bump(stroke)) < 1e-4 * base


def test_what_is_left_of_the_traces_without_a_lump_comes_from_the_sides_of_the_tissue():
    near = traces_vary(Settings())
    assert near < 1.2e-4
    assert traces_vary(Settings(hx_mm=1.0)) == pytest.approx(near, rel=0.1)  # it is not the mesh
    assert traces_vary(Settings(left_mm=-240.0, right_mm=240.0)) < near / 4


def traces_vary(settings: Settings) -> float:
    """Largest change along the traces of the inner twelve sensors without a lump, over the base."""
    images = simulate(replace(REFERENCE, E_ratio=1.0), settings).images_kPa
    return float(np.abs(images - images.mean(0))[:, 2:-2].max() / images.mean())


def test_strain_force_curves_are_power_laws_between_those_of_no_lump_and_a_rigid_one():
    curves = {E: strain_over_lump(E) for E in (1.0, 2.0, 5.0, 10.0, 50.0, 1000.0)}
    for strain in curves.values():
        assert power_law(FORCES, strain)[1] > 0.999
    stiffer = np.array(list(curves.values()))
    assert (np.diff(stiffer[1:], axis=0) < 0).all()
    assert (stiffer[1:] > stiffer[-1] - 1e-12).all()
    assert (stiffer[0] > stiffer[2:]).all()


def test_the_nonlinear_lump_is_soft_far_away_and_approaches_ten_times_the_fat_beneath_the_probe():
    lump, soft, hard = run("d10h08eNLf10"), of_stiffness(2.0), of_stiffness(10.0)
    assert lump.displacement_mm[0] == pytest.approx(soft.displacement_mm[0], rel=0.006)
    share = (soft.displacement_mm - lump.displacement_mm) / (soft.displacement_mm - hard.displacement_mm)
    assert (np.diff(share[2:]) > 0).all()  # gradually approaching that of E = 10
    assert share[-1] > 0.95


def test_the_nonlinear_lump_is_like_ten_or_more_over_the_lump_and_crosses_the_linear_ones():
    forces = (0.02, 0.05, *FORCES)
    felt = stiffness_felt(Case.from_code("d10h08eNLf10"), forces)
    assert (np.diff(felt) > 0).all()
    assert felt[0] < 1.3
    assert felt[1] < 2.0  # and so it crosses E = 2 and E = 5 on the way
    assert felt[2] < 3.6
    assert felt[-1] >= 10.0
    assert stiffness_felt(REFERENCE, [1.0])[0] == pytest.approx(10.0)


def test_the_place_of_the_peak_pressure_jumps_as_the_lump_comes_near():
    stroke = run("d10h03e10f10").full()
    jump = np.abs(np.diff(stroke.peak_mm))
    assert jump.max() > 4.0
    assert np.median(jump) < 2.5


@pytest.mark.parametrize(
    ("tolerance", "pressure_kPa", "displacement_mm"), [(1e-5, 1e-4, 1e-5), (1e-10, 1e-10, 1e-11)]
)
def test_a_stroke_from_the_other_side_is_the_mirror_image(tolerance, pressure_kPa, displacement_mm):
    """The mesh is symmetric when its sides are: what differs is what Newton's method leaves."""
    wide = Settings(left_mm=-120.0, right_mm=120.0, tolerance=tolerance)
    there = simulate(REFERENCE, wide, positions_mm=np.arange(-12, 13, 2.0))
    np.testing.assert_allclose(there.mirrored().images_kPa, there.images_kPa, atol=pressure_kPa)
    np.testing.assert_allclose(there.mirrored().displacement_mm, there.displacement_mm, atol=displacement_mm)


def test_loading_more_gives_what_loading_at_once_gives():
    low, high = simulate_forces(REFERENCE, [0.4, 1.0])
    np.testing.assert_allclose(high.images_kPa, of_stiffness(10.0).images_kPa, atol=2e-3)
    assert (low.displacement_mm < high.displacement_mm).all()


def test_stiffening_tissue_yields_less_the_harder_it_is_pressed():
    plain = np.array([s.strain[0] for s in load_curve(REFERENCE, FORCES, -28.0)])
    wellman = replace(REFERENCE, fat_stiffening=6.0, gland_stiffening=16.0)
    stiff = np.array([s.strain[0] for s in load_curve(wellman, FORCES, -28.0)])
    ratio = stiff / plain
    assert (np.diff(ratio) < 0).all()
    assert ratio[-1] < 0.95
    assert power_law(FORCES, stiff)[0] > power_law(FORCES, plain)[0]


def test_friction_breaks_the_symmetry_and_needs_the_whole_stroke():
    sliding = simulate(replace(REFERENCE, friction=0.2), Settings(start_mm=-16.0))
    assert sliding.positions_mm[-1] == 16.0
    difference = np.abs(sliding.mirrored().images_kPa - sliding.images_kPa).max()
    assert difference > 0.05
    with pytest.raises(ValueError, match="mirror"):
        simulate(replace(REFERENCE, friction=0.2), positions_mm=[-2, 0]).full()


@pytest.mark.parametrize(
    "change",
    [
        {"probe_radius_mm": float("inf")},
        {"probe_radius_mm": 25.0},
        {"face_half_mm": 6.0},
        {"fillet_per_mm2": 0.5},
        {"gland_mm": 30.0},
    ],
    ids=str,
)
def test_probe_shapes_and_layer_depths_are_parameters(change):
    stroke = simulate(replace(REFERENCE, **change), positions_mm=[-28, -26, 0])
    reference = simulate(REFERENCE, positions_mm=[-28, -26, 0])
    assert np.abs(stroke.images_kPa - reference.images_kPa).max() > 0.02
    assert np.abs(stroke.force_error).max() < 1e-6
