"""A stroke over a ball is inverted by the emulator, and the solver sets that right."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from palpate.cli.refine import lines_of
from palpate.inversion import solid_correction, solid_modes
from palpate.inversion.felt import NotInvertible, felt_stroke
from palpate.inversion.forward import Slopes
from palpate.inversion.solid_classes import ELLIPSOID, learnt
from palpate.inversion.solid_correction import Correction, correction_at
from palpate.inversion.solid_emulator import BINS, bundled
from palpate.inversion.solid_forward import SolidForward
from palpate.inversion.solid_posterior import SolidPosterior, binned
from palpate.inversion.strokes import invert_stroke, invert_together
from palpate.learn.emulator import inputs_of
from palpate.link.face import Face
from palpate.sim.probe.noise import level_named
from palpate.sim.tissue import Case, StrokeError
from palpate.sim.tissue.any_tissue import FORCE_PARTS
from palpate.sim.tissue.solid.derivatives import SolidDerivatives
from palpate.sim.tissue.solid.kept import read_kept
from palpate.sim.tissue.solid.press import felt
from palpate.sim.tissue.solid.stroke import RAMP
from tests.host.inversion.solid_world import felt_over
from tests.host.inversion.test_inversion import as_over_a_ball, frames

SET = Path(__file__).parents[2] / "sim" / "tissue" / "data" / "balls.parquet"
BALL = Case(12.0, 0.6, 20.0, 0.4, gland_ratio=4.0, shape="ball")


def emulated(case):
    """Three strokes over a lump and the press before them, by the emulator alone."""
    (lump,) = bundled()[0].lumps([replace(case, F_rel=case.F_rel * part) for part in FORCE_PARTS])
    return lump.strokes, lump.press


def without_solver(monkeypatch):
    def none(*_):
        raise StrokeError("nothing", 0.0, "is computed here")

    monkeypatch.setattr(solid_modes, "correction_at", none)


def test_a_lump_that_ends_across_is_a_solid_one():
    assert not felt_stroke(**frames()).solid
    found = felt_stroke(**frames(pressure_kPa=as_over_a_ball()))
    assert found.solid and found.take(np.array([3]), np.array([2, 5])).image_kPa.shape == (3, 16, 26)
    with pytest.raises(NotInvertible, match="own probe only"):
        felt_stroke(**frames(pressure_kPa=as_over_a_ball()), face=Face(40.0))


def test_tissue_that_ends_beside_the_face_is_solid_too():
    """A ball of 5 mm, 10 mm deep, was taken for a cylinder that did not fit: no column changes by enough."""
    made = frames()
    sides = 1 + 0.2 * (np.linspace(-1, 1, 26) ** 2 - 1 / 3)
    bent = made | {"pressure_kPa": made["pressure_kPa"] * sides}
    assert felt_stroke(**bent).solid
    assert not felt_stroke(**bent, face=Face(40.0)).solid


def test_sides_are_felt_where_outer_columns_rise_and_others_sink():
    """Thin tissue without a lump was told as a lump in undulating tissue: no parabola lay in its columns."""
    made = frames()
    across = np.linspace(-1, 1, 26)[:, None] ** [0, 2, 4]
    *_, wave = np.linalg.qr(across)[0].T
    assert felt_stroke(**(made | {"pressure_kPa": made["pressure_kPa"] * (1 + 0.3 * wave)})).solid
    assert not felt_stroke(**(made | {"pressure_kPa": made["pressure_kPa"] * (1 + 0.1 * wave)})).solid


def test_a_dead_column_is_no_side():
    made = frames()
    dead = np.zeros((16, 26), bool)
    dead[:, 20] = True
    assert not felt_stroke(**(made | {"dead": dead})).solid


def test_dead_cells_make_no_ball_of_a_narrow_cylinder():
    """A shallow cylinder was refused for five dead cells, which took a bump from their columns."""
    made = frames()
    rows = 1.5 * (np.arange(16) - 7.5)
    bump = 12.0 * np.exp(-(((rows + made["place_mm"][:, None]) / 4.0) ** 2))
    pressure = made["pressure_kPa"] + bump[:, :, None]
    dead = np.zeros((16, 26), bool)
    dead[[5, 6, 7, 9, 11], [8, 8, 9, 9, 10]] = True
    assert not felt_stroke(**(made | {"pressure_kPa": np.where(dead, 0.0, pressure), "dead": dead})).solid


def otherwise(rng):
    """What a solver might say otherwise of `BALL`."""
    positions, bins = len(bundled()[0].positions_mm), BINS[0] * BINS[1]
    shapes = (3, positions, bins), (3, positions), (5, bins), (5,)
    slopes = (positions + 2, bins, 11), (positions + 2, 11)
    by = Slopes(*(1e-3 * rng.standard_normal(shape) for shape in slopes))
    return Correction(BALL, *(1e-3 * rng.standard_normal(shape) for shape in shapes), by)


@pytest.mark.parametrize("corrected", [False, True])
def test_the_slopes_of_emulated_frames_are_their_derivatives(corrected):
    """Where all forces grow together they were not, and searches over solid lumps stopped too early."""
    of, rng = learnt(ELLIPSOID, (2.0, 10.0), len(bundled()[1].image)), np.random.default_rng(3)
    forward = SolidForward(of, 2, otherwise(rng) if corrected else None)
    theta = of.column("mean") + 0.1 * of.column("sd") * rng.standard_normal(len(of.unknowns))
    places = np.array([-31.0, -31.0, -19.0, -7.0, -1.0, 4.0, 13.0])
    forces = np.array([20.0, 38.0, 50.0, 52.0, 47.0, 50.0, 51.0])
    slopes = forward(theta, places, forces).slopes
    for _ in range(3):
        step, moved = 1e-4 * of.column("sd") * rng.standard_normal(len(theta)), 1e-4 * rng.standard_normal(7)
        check(forward, slopes, (theta, places, forces), (step, moved, np.zeros(7)))
    check(forward, slopes, (theta, places, forces), (0 * theta, np.zeros(7), np.full(7, 1e-4)))
    check(forward, slopes, (theta, places, forces), (0 * theta, np.zeros(7), 1e-4 * rng.standard_normal(7)))


def check(forward, slopes, at, steps):
    """That slopes lead to what small steps of unknowns, places and ln forces change."""
    (theta, places, forces), (step, moved, harder) = at, steps
    more, less = (forward(theta + s * step, places + s * moved, forces * np.exp(s * harder)) for s in (1, -1))
    own = np.column_stack([np.tile(step, (len(places), 1)), moved, harder])
    led, apart = np.einsum("nck,nk->nc", slopes.images, own), (more.images - less.images) / 2
    assert np.abs(led - apart).max() < 0.01 * np.abs(apart).max()
    assert np.allclose((slopes.depth * own).sum(1), (more.depth - less.depth) / 2, rtol=1e-2, atol=1e-7)


def theta_of(of, case):
    """A guess of the class that is this case."""
    theta = of.column("mean")
    along, across, down = case.half_axes_mm
    lengths = np.log([2 * along, case.depth_mm, case.gland_ratio, case.gland_mm, case.probe_radius_mm])
    theta[[0, 1, 3, 4, 7]] = lengths
    theta[[2, 5, 6, 8]] = case.E_inv23, case.fat_stiffening, case.gland_stiffening, case.offset_mm
    theta[9:11] = np.log(across / along), np.log(down / along)
    return theta


def test_what_the_solver_says_is_what_is_predicted_there(monkeypatch):
    """A lump of the kept set stands for the solver's stroke."""
    kept = read_kept(SET)[3:6]
    monkeypatch.setattr(solid_correction, "strokes_with_derivatives", lambda *_, **__: (kept, None))
    case = kept[1].case
    emulator = bundled()[0]
    correction = correction_at(case, emulator)
    of = learnt(ELLIPSOID, (2.0, 10.0), len(bundled()[1].image))
    places = np.concatenate([[-30.0], emulator.positions_mm])
    force = np.full(len(places), case.F_N_per_m * 10 / case.fat_kPa)
    computed = kept[1].images_kPa.reshape(len(places) - 1, *BINS, 2).mean(-1).reshape(len(places) - 1, -1)
    off = [
        np.abs(
            SolidForward(of, 1, by)(theta_of(of, case), places, force).images[1:] * case.fat_kPa / 10
            - computed
        ).max()
        for by in (None, correction)
    ]
    assert off[1] < 0.02 and off[1] < 0.3 * off[0]


def as_if_larger(case, forces):
    """Press and strokes by a solver that takes a lump for a larger one over a softer gland."""
    other = replace(case, d_mm=1.04 * case.d_mm, gland_ratio=0.9 * case.gland_ratio)
    rising = [*(part * forces[0] for part in RAMP), *forces]
    x = np.array([inputs_of(replace(other, F_rel=force)) for force in rising])
    images, depths = bundled()[0].pressed(x)
    low = len(RAMP)
    return images[:low], depths[:low], *bundled()[0].stroked(x[low:], images[low:], depths[low:])


def with_derivatives(case, forces, settings, positions_mm, by, ramp, at, only):
    """As `strokes_with_derivatives` by such a solver."""
    found = as_if_larger(case, forces)
    strokes = [
        SimpleNamespace(
            case=replace(case, F_rel=force), ramp_images_kPa=found[0], ramp_displacement_mm=found[1],
            images_kPa=image, displacement_mm=depth,
        )
        for force, image, depth in zip(forces, *found[2:])
    ]  # fmt: skip
    slopes = []
    for name in by:
        step = 1e-5 * max(abs(getattr(case, name)), 1.0)
        other = replace(case, **{name: getattr(case, name) + step})
        slopes.append([(more - now) / step for more, now in zip(as_if_larger(other, forces), found)])
    slopes += [[np.zeros_like(one) for one in found]] * 2
    of_ramp, of_ramp_depth, of_image, of_depth = (np.stack(one, -1) for one in zip(*slopes))
    by = (*by, "place_mm", "force_N_per_m")
    return strokes, SolidDerivatives(by, of_image[at, only], of_depth[at, only], of_ramp, of_ramp_depth)


def test_near_the_guess_what_the_solver_says_is_predicted_to_first_order(monkeypatch):
    """Searches ended where the emulator's slope was none, not where the solver's misfit is least."""
    monkeypatch.setattr(solid_correction, "strokes_with_derivatives", with_derivatives)
    case = replace(BALL, shape="ellipsoid", half_across_mm=5.0, half_down_mm=7.0, offset_mm=3.0)
    by = correction_at(case, bundled()[0])
    of = learnt(ELLIPSOID, (2.0, 10.0), len(bundled()[1].image))
    theta, rng = theta_of(of, case), np.random.default_rng(6)
    theta[:11] += 0.03 * rng.standard_normal(11) * of.column("sd")[:11]
    there = replace(of.case(theta), F_rel=case.F_rel)
    places = bundled()[0].positions_mm
    *_, images, depths = as_if_larger(there, [case.F_rel * part for part in FORCE_PARTS])
    said = images[1].reshape(len(places), *BINS, 2).mean(-1).reshape(len(places), -1)
    force = np.full(len(places), case.F_N_per_m)
    found = [SolidForward(of, 0, one)(theta, places, force) for one in (replace(by, by=None), by)]
    level, first = (np.median(np.abs(one.images - said)) for one in found)
    assert first < 0.2 * level
    level, first = (np.median(np.abs(one.depth - depths[1])) for one in found)
    assert first < 0.2 * level


def test_an_emulated_ball_is_found_again(monkeypatch):
    without_solver(monkeypatch)
    felt, start, stream = felt_over(*emulated(BALL), 4)
    assert felt.solid
    found = invert_stroke(felt, start, level_named("typical"))
    assert found.fits and found.kind in ("ball", "ellipsoid"), found
    true = {"d_mm": 12.0, "width_mm": 12.0, "depth_mm": 7.2, "t_mm": 13.2, "E_inv23": BALL.E_inv23}
    for name, value in (true | {"E_fat_kPa": stream.truth.fat_kPa}).items():
        said = found.values[name]
        assert said.low < value < said.high, (name, said)
    lines = lines_of(found)  # its name was missing there: every ball ended in a KeyError
    assert ": a ball; fits" in lines[0] or ": an ellipsoid; fits" in lines[0]
    assert any(line.strip().startswith("width across") for line in lines)
    assert abs(found.centre_mm - stream.truth.centre_mm) < 1.0

    (laid,) = found.laid
    assert laid.measured_kPa.shape[1] == 16
    assert "--class border" in invert_stroke(felt, start, level_named("typical"), "border").problem


def test_a_lump_of_another_stiffness_that_feels_alike_is_asked_about_too(monkeypatch):
    """A ball thirty times as stiff as the fat was told as five times: the emulator, asked elsewhere, had no
    mode there."""
    asked = []

    def nothing_otherwise(case, _):
        asked.append(case)
        same = otherwise(SimpleNamespace(standard_normal=np.zeros))
        return replace(same, case=case)

    monkeypatch.setattr(solid_modes, "correction_at", nothing_otherwise)
    invert_stroke(*felt_over(*emulated(BALL), 5)[:2], level_named("typical"))
    hard = [case.E_inv23 < 0.25 for case in asked if case.has_lump]
    assert any(hard) and not all(hard)


def test_tissue_without_a_lump_is_told_so(monkeypatch):
    """It was told as a ball with wide intervals: no class that a face's sides are felt in was without one."""
    without_solver(monkeypatch)
    strokes, press = emulated(replace(BALL, d_mm=5.0, h=2.2, E_ratio=2.0))
    alike = [
        felt(one.case, one.positions_mm, one.displacement_mm[:1].repeat(n), one.images_kPa[:1].repeat(n, 0))
        for one in strokes
        for n in [len(one.positions_mm)]
    ]
    made, start, _ = felt_over(alike, press, 4)
    found = invert_stroke(made, start, level_named("typical"))
    assert made.solid and found.fits and found.kind == "none" and "d_mm" not in found.values, found
    assert found.classes["none"] > 0.9
    assert found.values["t_mm"].low < 13.5 < found.values["t_mm"].high
    assert ": no lump; fits" in lines_of(found)[0]


def test_strokes_over_one_ball_say_more_together_each_along_its_line(monkeypatch):
    """They shared their offset: width came out as 8 mm, and it fitted."""
    without_solver(monkeypatch)
    noise = level_named("typical")
    lines = [replace(BALL, offset_mm=offset) for offset in (1.5, 5.5)]
    felt = [felt_over(*emulated(case), seed, probe=4)[:2] for case, seed in zip(lines, (4, 5))]
    both, alone = invert_together(felt, noise), invert_together(felt[:1], noise)
    assert both.together == 2 and both.fits and both.centre_mm is None and len(both.laid) == 2
    for name, true in {"d_mm": 12.0, "width_mm": 12.0, "depth_mm": 7.2, "t_mm": 13.2}.items():
        said, less = both.values[name], alone.values[name]
        assert said.low < true < said.high, (name, said)
        assert said.high / said.low < less.high / less.low, name


def test_a_gain_that_a_row_shares_is_not_its_bins_own():
    """Every bin was taken to have a gain of its own as large as its row's."""
    noise = replace(level_named("typical"), row_gain=0.02)
    felt, start, _ = felt_over(*emulated(BALL), 4)
    of = learnt(ELLIPSOID, (2.0, 10.0), len(bundled()[1].image))
    posterior = SolidPosterior(of, binned(felt), noise)
    z = posterior.start(of.column("mean"), start.E_kPa, start.lump_mm)
    found = SolidForward(of, felt.press)(of.column("mean"), posterior.places(z), posterior.forces(z))
    step = 1e-3 * np.random.default_rng(1).standard_normal(16)
    more = z.copy()
    more[posterior.at["gain"]] += step
    slopes, _ = posterior.jacobian(z, found, found.slopes)
    led = slopes[:, posterior.at["gain"]] @ step
    apart = posterior.misfit(more, found).data - posterior.misfit(z, found).data
    np.testing.assert_allclose(led, apart.ravel(), rtol=1e-6, atol=1e-9)
    assert posterior.misfit(more, found).prior[posterior.at["gain"]] == pytest.approx(step / 0.02)


def test_a_lump_far_beside_the_line_is_found_there(monkeypatch):
    """The columns said 6.8 mm where it lay 8.5 mm beside, and the search stayed where it began."""
    without_solver(monkeypatch)
    beside = replace(BALL, offset_mm=8.5)
    felt, start, _ = felt_over(*emulated(beside), 4)
    found = invert_stroke(felt, start, level_named("typical"))
    assert found.fits, found
    for name, true in {"d_mm": 12.0, "width_mm": 12.0, "depth_mm": 7.2, "t_mm": 13.2}.items():
        said = found.values[name]
        assert said.low < true < said.high, (name, said)
