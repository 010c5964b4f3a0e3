"""A stroke is inverted by the model that computes strokes, and what cannot be inverted is said."""

import json
import subprocess

import numpy as np
import pytest

from palpate.inversion.classes import ANYWHERE, BORDER, CLASSES, NONE
from palpate.inversion.departures import DEPARTURES
from palpate.inversion.felt import FeltStroke, NotInvertible, felt_stroke
from palpate.inversion.forward import COARSE, Forward
from palpate.inversion.joint import Together
from palpate.inversion.posterior import USUAL_MESH, Posterior
from palpate.inversion.result import worst_part
from palpate.inversion.search import search
from palpate.inversion.strokes import invert_stroke
from palpate.sim.probe.emulated import EmulatedProbe
from palpate.sim.probe.noise import LEVELS
from palpate.sim.probe.over_lump import strokes_over
from palpate.sim.probe.sensors import stroke_frames
from palpate.sim.tissue import Case, CaseError, simulate
from tests.docs.blocks import ROOT
from tests.docs.test_reference import fields_in_the_page
from tests.host.inversion.world import felt_of, of_stream

PALPATE = ROOT / ".venv" / "bin" / "palpate"


def a_few_frames(of, rng):
    """A posterior of frames that nobody has felt: what derivatives are tried on."""
    place = np.array([-20.0, -20.0, -9.0, -3.0, 2.0, 7.0])
    n = len(place)
    stroke = FeltStroke(
        rng.uniform(1, 8, (n, 16)), np.full(16, 26), rng.uniform(1, 3, n), place,
        np.array([0, 0, 0.2, 0.4, 0.7, 1.0]), np.array([-30.0, -20, -9, -3, 2, 7]), 1,
    )  # fmt: skip
    posterior = Posterior(of, stroke, LEVELS["typical"], USUAL_MESH)
    z = posterior.start(of.column("mean"), 9.0, 0.5)
    z[posterior.at["force"]] = np.log(5.0) + np.linspace(0, rng.uniform(-0.1, 0.1), n)
    z[posterior.at["place"]] = rng.normal(0, 0.2, n - 1)
    z[posterior.at["scale"]], z[posterior.at["creep"]], z[posterior.at["drift"]] = 0.01, 0.02, 0.1
    z[posterior.at["gain"]] = rng.normal(0, 0.02, 16)
    return posterior, z


def check_jacobian(posterior, forward, z, rng, steps=1, within=0.02):
    """It is the misfit's derivative, along random small steps."""

    def computed(z):
        return forward(z[posterior.at["tissue"]], posterior.places(z), posterior.forces(z))

    found = computed(z)
    A, B = posterior.jacobian(z, found, forward.slopes(found))
    for _ in range(steps):
        step = 2e-4 * np.minimum(posterior.sd, 3.0) * rng.standard_normal(len(z))
        forces = ~np.isfinite(posterior.sd)
        step[forces] = 2e-4 * rng.standard_normal(forces.sum())
        ends = [posterior.misfit(z + sign * step, computed(z + sign * step)) for sign in (-1, 1)]
        difference = (ends[1].data - ends[0].data).ravel() / 2
        assert np.abs(A @ step - difference).max() < within * np.abs(difference).max()
        assert np.allclose(B @ step, (ends[1].prior - ends[0].prior) / 2)


@pytest.mark.parametrize("of", [ANYWHERE, NONE])
def test_the_posterior_s_jacobian_is_its_derivative(of):
    rng = np.random.default_rng(4)
    posterior, z = a_few_frames(of, rng)
    check_jacobian(posterior, Forward(of, COARSE), z, rng, steps=3)


def test_strokes_together_share_their_tissue_and_nothing_else():
    """The joint Jacobian is the joint misfit's derivative; what is known of the tissue counts once."""
    rng = np.random.default_rng(5)
    parts, own = zip(*(a_few_frames(ANYWHERE, rng) for _ in range(2)))
    both, forward = Together(parts), Forward(ANYWHERE, COARSE)
    z = both.joined(own)
    assert both.size == 2 * parts[0].size - len(ANYWHERE.unknowns) - 1

    check_jacobian(both, forward, z, rng)


def test_a_misfit_that_is_no_number_is_no_mode():
    """Every comparison with it is false: it had fitted, and could not be kept."""
    posterior, z = a_few_frames(NONE, np.random.default_rng(8))
    posterior.stroke.displacement_mm[2] = np.nan
    with pytest.raises(CaseError, match="no number"):
        search(posterior, Forward(NONE, COARSE), z, 3)


def test_broyden_s_update_leads_from_one_guess_to_the_next():
    rng = np.random.default_rng(6)
    posterior, z = a_few_frames(ANYWHERE, rng)
    forward = Forward(ANYWHERE, COARSE)
    ends = []
    for theta in (z[posterior.at["tissue"]], z[posterior.at["tissue"]] + 0.02):
        ends.append(forward(theta, posterior.places(z), posterior.forces(z)))
    slopes = forward.slopes(ends[0]).secant(*ends, forward.scale)
    step = ends[1].own - ends[0].own
    led = ends[0].images + np.einsum("nik,nk->ni", slopes.images, step)
    assert np.allclose(led, ends[1].images)
    assert np.allclose(ends[0].depth + (slopes.depth * step).sum(1), ends[1].depth)


def test_a_class_s_chain_leads_from_its_unknowns_to_the_case_s_fields():
    for of in CLASSES.values():
        theta = of.column("mean")
        assert of.chain(theta).shape == (len(of.fields), len(theta))
    theta = BORDER.column("mean")
    case, chain = BORDER.case(theta), BORDER.chain(theta)
    assert case.fat_mm is None
    assert chain[BORDER.fields.index("d_mm"), 0] == pytest.approx(case.d_mm, rel=1e-6)
    assert chain[BORDER.fields.index("h"), 0] == pytest.approx(-case.h, rel=1e-6)


def frames(n=40, press=10, **changed):
    """Pressures, dead cells, displacements, places, times and the press of a made-up stroke."""
    place = np.concatenate([np.full(press, -30.0), np.linspace(-30, 30, n - press)])
    parts = {
        "pressure_kPa": np.full((n, 16, 26), 5.0),
        "dead": np.zeros((16, 26), bool),
        "displacement_mm": np.linspace(0.5, 2.0, n),
        "place_mm": place,
        "time_s": np.arange(n) / 37.5,
        "press": press,
    }
    return parts | changed


def as_over_a_ball():
    pressure = np.full((40, 16, 26), 5.0)
    pressure[20:30, :, 10:16] += 4.0
    return pressure


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"press": 0}, "no press before it"),
        ({"displacement_mm": np.full(40, 1.0)}, "no displacement"),
        ({"place_mm": np.linspace(0, 9, 40)}, "too short"),
        ({"pressure_kPa": np.full((40, 16, 26), np.nan)}, "no number"),
        ({"dead": np.arange(416).reshape(16, 26) < 26}, "row 0 has no live cell"),
    ],
)
def test_what_cannot_be_inverted_is_said(changed, said):
    assert felt_stroke(**frames()).press == 10
    with pytest.raises(NotInvertible, match=said):
        felt_stroke(**frames(**changed))


def test_a_dead_cell_leaves_its_row_s_mean_alone():
    dead = np.zeros((16, 26), bool)
    dead[3, 5] = True
    pressure = np.full((40, 16, 26), 5.0)
    pressure[:, 3, 5] = -0.4
    assert np.allclose(felt_stroke(**frames(pressure_kPa=pressure, dead=dead)).rows_kPa, 5.0)


def test_the_worst_part_is_named():
    data = np.full((6, 17), 0.5)
    data[:, 16] = 4.0
    assert worst_part(data, np.zeros(6)).startswith("the displacement")
    data = np.full((6, 17), 0.5)
    data[:, 4] = 3.0
    assert worst_part(data, np.zeros(6)).startswith("row 4")


def record(stream, calibration, path, *more):
    """What an emulated probe sends of a stroke, recorded by the command line, and what that said."""
    with EmulatedProbe("cpython", [stream], roomy=True, calibration=calibration) as probe:
        words = ["stream", "--port", probe.port, "--strokes", "1", "--record", path, *more]
        done = subprocess.run([PALPATE, *words], capture_output=True, text=True, timeout=800)
    assert path.exists(), done.stderr
    return done


def refined(*words):
    return subprocess.run([PALPATE, "refine", *words], capture_output=True, text=True, timeout=800)


def test_a_stroke_of_another_mesh_is_refined_by_the_command_line(tmp_path):
    """Computed frame by frame on a finer mesh, felt by the emulated probe, recorded, refined."""
    case = Case(11.0, 0.6, 8.0, 0.55, fat_stiffening=1.0, gland_stiffening=1.0)
    _, _, stream, calibration = felt_of(case, 5)
    record(stream, calibration, tmp_path / "visit.mcap")
    done = refined(tmp_path / "visit.mcap", "--class", "border", "--json")
    assert done.returncode == 0, done.stderr
    (stroke,) = json.loads(done.stdout)["strokes"]
    assert set(stroke) == fields_in_the_page("refine") - {
        "width_mm", "d2_mm", "depth2_mm", "apart_mm",
    }  # fmt: skip
    assert stroke["fits"], stroke
    assert stroke["class"] == "border" and stroke["classes"]["border"] > 0.9
    assert set(stroke["classes"]) - {"border"} <= set(DEPARTURES)
    for name, true, within in (("d_mm", 11.0, 0.12), ("depth_mm", 6.6, 0.12), ("t_mm", 12.1, 0.1)):
        said = stroke[name]
        assert abs(np.log(said["value"] / true)) < within, stroke
        assert said["low"] < said["value"] < said["high"]
    said = stroke["E_fat_kPa"]
    assert abs(np.log(said["value"] / stream.truth.fat_kPa)) < 0.12

    # what was kept is told again, even where somebody has changed it
    kept = tmp_path / "visit.mcap.refined"
    assert json.loads(done.stdout)["kept"] == [str(kept)]
    told = json.loads(kept.read_text())
    told["answers"][0]["answer"]["worst"] = "edited"
    kept.write_text(json.dumps(told))
    words = ["--class", "border", "--json", "--report", tmp_path / "report"]
    again = refined(tmp_path / "visit.mcap", *words)
    assert (tmp_path / "report" / "beyond_4.svg").exists(), again.stderr
    assert json.loads(again.stdout)["strokes"] == [{**stroke, "worst": "edited"}]


def test_a_stroke_of_an_emulated_probe_fits_and_its_intervals_hold():
    """None did: its press was drawn between four forces, on a coarse mesh and with straight lines to the end
    of the contact."""
    (stream,), calibration = strokes_over("d12h07e20f09", seed=5)
    found = invert_stroke(*of_stream(stream, calibration), LEVELS["typical"])
    assert found.fits, found
    for name, true in (("d_mm", 12.0), ("depth_mm", 8.4), ("t_mm", 14.4), ("E_inv23", 20.0 ** (-2 / 3))):
        assert found.values[name].low <= true <= found.values[name].high, (name, found.values[name])


def test_a_recording_without_a_press_is_refused_in_a_sentence(tmp_path):
    stream = stroke_frames(simulate(Case.from_code("d10h08e10f10")), "none", 1)
    live = record(stream, None, tmp_path / "bare.mcap", "--refine", "--json")
    (one,) = json.loads(live.stdout)["refined"]
    assert "no press before it" in one["problem"] and one["stroke"] == 1
    done = refined(tmp_path / "bare.mcap")
    assert done.returncode == 1
    assert "no press before it" in done.stderr and "Traceback" not in done.stderr
