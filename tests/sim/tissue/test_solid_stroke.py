"""Strokes over solid lumps: symmetric where they have to be, in balance, and kept like any other."""

import functools
import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from palpate.errors import UsageError
from palpate.sim.probe.sensors import SensorModel, StrokeField, stroke_frames, unpack
from palpate.sim.tissue import (
    Case,
    CaseError,
    Settings,
    SolidStroke,
    load_strokes,
    simulate,
    simulate_forces,
    sweep,
)
from palpate.sim.tissue.solid.kept import keep, read_kept, read_recipe

COARSE = Settings(hx_mm=4.0)
BALL = Case.from_code("d10h06e10f08_ball")


@functools.cache
def ball(positions=(-28.0, -12.0, -8.0, -4.0, 0.0)) -> SolidStroke:
    return simulate(BALL, COARSE, positions)


def test_a_ball_is_felt_where_it_is():
    stroke = ball()
    assert stroke.images_kPa.shape == (5, 16, 26)
    far, over = stroke.images_kPa[[0, -1]]
    assert over[7:9, 12:14].mean() > 1.15 * far[7:9, 12:14].mean()
    assert over[7:9, [2, 23]].mean() == pytest.approx(far[7:9, [2, 23]].mean(), rel=0.05)
    assert (np.diff(stroke.displacement_mm)[:2] < 0).all()
    assert np.abs(stroke.peak_across_mm[-1]) < 1
    # The face is wider than its sensors; these take most of the force.
    share = stroke.images_kPa.sum((1, 2)) * 1.5**2 / 1000 / BALL.F_N
    assert ((share > 0.9) & (share < 1)).all()


def test_forces_balance_and_no_element_is_turned_inside_out():
    stroke = ball()
    assert np.abs(stroke.force_error).max() < 1e-6
    assert stroke.smallest_jacobian.min() > 0.5


def test_images_are_symmetric_across_the_line_and_over_the_lump_along_it():
    images = ball().images_kPa
    np.testing.assert_allclose(images[:, :, ::-1], images, atol=1e-12)
    sides = 0.01 * images.max()  # the tissue's ends stand at 100 and 80 mm
    np.testing.assert_allclose(images[-1, ::-1], images[-1], atol=sides)


def test_lumps_on_either_side_give_mirror_images():
    left, right = (
        simulate(Case.from_code(f"d08h05e50f06_ball_y{y}"), COARSE, [0.0]).images_kPa[0] for y in (-5, 5)
    )
    np.testing.assert_allclose(left[:, ::-1], right, atol=2e-4)
    assert right[:, 13:].mean() > 1.02 * right[:, :13].mean()


def test_the_whole_width_agrees_with_the_half_where_the_lump_is_on_the_line():
    """An offset of a thousandth of a millimetre takes the other mesh."""
    half, whole = (simulate(replace(BALL, offset_mm=y), COARSE, [0.0]) for y in (0.0, 1e-3))
    assert whole.nodes > 1.7 * half.nodes
    assert whole.displacement_mm == pytest.approx(half.displacement_mm, rel=2e-3)
    inner = (slice(None), slice(2, 14), slice(2, 24))
    difference = np.abs(whole.images_kPa - half.images_kPa)[inner]
    assert difference.max() < 0.03 * half.images_kPa.max()


def test_a_stroke_from_json_is_the_stroke():
    stroke = ball()
    again = SolidStroke.from_dict(json.loads(json.dumps(stroke.to_dict())))
    assert again.case == stroke.case
    np.testing.assert_array_equal(again.images_kPa, stroke.images_kPa)
    whole = stroke.full()
    assert len(whole.positions_mm) == 9
    np.testing.assert_array_equal(whole.images_kPa[-1], stroke.images_kPa[0, ::-1])
    np.testing.assert_array_equal(whole.mirrored().images_kPa[0], stroke.images_kPa[0])


def test_two_forces_together_are_the_two_strokes():
    # Between columns of 4 mm the face's rounded edge leaves this force two equilibria; of 3 and 2 mm, one.
    settings = Settings(hx_mm=3.0, increment_mm=3.0)
    low, high = simulate_forces(BALL, [BALL.F_rel, 1.4 * BALL.F_rel], settings, [-3.0, 0.0])
    alone = simulate(replace(BALL, F_rel=1.4 * BALL.F_rel), settings, [-3.0, 0.0])
    np.testing.assert_allclose(high.images_kPa, alone.images_kPa, atol=2e-3)
    assert (high.displacement_mm > low.displacement_mm).all()


def test_one_factor_serves_neighbouring_positions_and_costs_no_accuracy():
    sparing = simulate(BALL, None, [-8.0, -6.0, -4.0, -2.0, 0.0])
    alone = simulate(BALL, Settings(tolerance=2e-7), [0.0])
    assert sparing.factorisations < len(sparing.positions_mm)
    np.testing.assert_allclose(sparing.images_kPa[-1], alone.images_kPa[0], atol=2e-3)


def test_the_emulated_sensors_see_the_images():
    stroke = ball()
    field = StrokeField(stroke)
    model = SensorModel(field, replace(stroke_noise(), quantise=True), 0)
    counts = np.array([unpack(packed) for packed in model.stroke(57).packed])
    kPa = counts.reshape(-1, 16, 26) / 4095 * 25 - 0.5
    assert kPa[28] == pytest.approx(stroke.images_kPa[-1], abs=0.0031)
    assert stroke_frames(stroke, "none").truth.case.d_mm == 10
    with pytest.raises(UsageError, match="width"):
        SensorModel(field, stroke_noise(), 0, across_mm=3.9)


def stroke_noise():
    from palpate.sim.probe.noise import Noise

    return Noise()


def test_a_sweep_keeps_balls_with_their_ramp_and_goes_on(tmp_path):
    here = ThreadPoolExecutor(1)
    cases = [replace(BALL, F_rel=F) for F in (0.3, 0.42)] + [Case(10, 0.8, 10, F_rel=0.5)]
    settings = Settings(hx_mm=4.0, start_mm=-8.0, increment_mm=4.0)
    table = sweep(cases, settings, tmp_path, executor=here)
    assert list(table.status) == ["ok"] * 3
    strokes = load_strokes(tmp_path)
    assert [stroke.case for stroke in strokes] == cases
    assert strokes[0].images_kPa.shape[1:] == (16, 26)
    assert strokes[2].images_kPa.shape[1:] == (16,)
    assert strokes[0].ramp_images_kPa.shape == (2, 16, 26)
    assert (np.diff([*strokes[0].ramp_displacement_mm, strokes[0].displacement_mm[0]]) > 0).all()
    again = sweep(cases, settings, tmp_path, executor=here)
    assert list(again.key) == list(table.key)

    kept = tmp_path / "kept.parquet"
    assert keep(tmp_path, kept, "by hand", settings) == 2
    assert read_recipe(kept)["design"] == "by hand"
    for stroke, same in zip(strokes, read_kept(kept)):
        assert same.case == stroke.case
        np.testing.assert_allclose(same.images_kPa, stroke.images_kPa, atol=5.1e-4)
        np.testing.assert_allclose(same.ramp_images_kPa, stroke.ramp_images_kPa, atol=5.1e-4)
        np.testing.assert_allclose(same.displacement_mm, stroke.displacement_mm, rtol=1e-6)
    kept.write_bytes(kept.read_bytes()[:-9])
    with pytest.raises(CaseError, match="kept set"):
        read_kept(kept)


def test_with_all_rows_a_deeper_lump_is_felt_steadily_less():
    """Between these depths a row of elements used to go, and the bump fell by a third of what it should."""

    def bump(depth_mm):
        case = Case(6.0, depth_mm / 6.0, 8.0, 0.8, shape="ball", gland_ratio=1.0, gland_mm=22.0)
        settings = Settings(hx_mm=3.0, layer_mm=4.0, all_rows=True)
        (stroke,) = simulate_forces(case, [0.8], settings, [-28.0, 0.0])
        before, over = stroke.images_kPa
        return (over - before)[4:12, 6:20].mean()

    first, second, third = map(bump, (10.1, 10.2, 10.3))
    assert second - third == pytest.approx(first - second, rel=0.1)


def test_a_lump_that_does_not_fit_is_refused():
    with pytest.raises(CaseError, match="wide"):
        simulate(Case.from_code("d10h08e10f10_ellipsoid48x4"))


def test_a_border_that_the_mesh_cannot_follow_cuts_its_elements():
    # One of 250 random lumps, wide and with the border near its lower end, folded an element over.
    code = "d21.48h0.4467e2.07f0.1787_ball_R39.83_g19.56_G9.791_sf2.565_sg1.739_t{}"
    cut, followed = (simulate(Case.from_code(code.format(t)), COARSE, (-4.0, 0.0)) for t in (27.7, 27.6))
    np.testing.assert_allclose(cut.displacement_mm, followed.displacement_mm, rtol=1e-3)
    np.testing.assert_allclose(cut.images_kPa, followed.images_kPa, atol=0.005 * followed.images_kPa.max())
