"""Lumps in the plane are looked for by an emulator that the solver sets right where a search ends."""

import json
from dataclasses import replace

import numpy as np
import pytest

from palpate.inversion.classes import ANYWHERE, NONE
from palpate.inversion.emulated import EmulatedForward, bundled, emulates
from palpate.inversion.forward import Forward
from palpate.learn.plane_emulator import (
    HIGH,
    INPUTS,
    LOW,
    MESH,
    ROWS,
    read_plane_emulator,
    write_plane_emulator,
)
from palpate.learn.plane_fit import errors_of, fit_plane_emulator
from palpate.learn.plane_frames import BLOCKS, Block, plane_frames
from palpate.models import file_hash, plane_emulator_path
from tests.host.inversion.test_inversion import a_few_frames, check_jacobian

# Two of the cases that the bundled emulator was fitted to: no other seed, no other numbers.
FEW = Block(17, 0, 3)


@pytest.fixture(scope="module")
def few(tmp_path_factory):
    """Their frames, which case each is of, and where they are kept."""
    directory = tmp_path_factory.mktemp("frames")
    return *plane_frames(directory, [FEW]), directory


def test_the_emulator_s_derivatives_are_its_own_differences():
    rng = np.random.default_rng(1)
    x = LOW + rng.uniform(0.1, 0.9, (20, len(INPUTS))) * (HIGH - LOW)
    emulator = replace(bundled(), **{
        name: tuple(one.astype(float) for one in getattr(bundled(), name)) for name in ("weights", "biases")
    })  # fmt: skip
    _, by = emulator(x)
    step = 1e-5 * rng.standard_normal(x.shape) * (HIGH - LOW)
    difference = (emulator(x + step)[0] - emulator(x - step)[0]) / 2
    assert np.allclose(np.einsum("nok,nk->no", by, step), difference, rtol=1e-3, atol=1e-8)


def test_beyond_its_range_it_goes_on_along_its_tangent_and_far_from_the_lump_it_stays_as_it_is():
    x = np.tile((LOW + HIGH) / 2, (3, 1))
    x[:, 0] = HIGH[0]
    x[1, 0] += 0.2
    (there, beyond, _), by = bundled()(x)
    assert np.allclose(beyond, there + 0.2 * by[0, :, 0])
    x[:, INPUTS.index("place")] = LOW[INPUTS.index("place")] - np.array([0.0, 5.0, 30.0])
    x[:, 0] = HIGH[0]
    said, by = bundled()(x)
    assert np.allclose(said[0], said[2], rtol=1e-12) and not by[1:, :, INPUTS.index("place")].any()


def test_frames_that_are_kept_are_not_computed_again_and_their_derivatives_are_theirs(few):
    frames, cases, directory = few
    assert len(np.unique(cases)) >= 2 and frames.slopes.shape == (len(cases), ROWS + 1, len(INPUTS))
    (path,) = directory.iterdir()
    before = path.stat().st_mtime_ns
    again, _ = plane_frames(directory, [FEW])
    assert path.stat().st_mtime_ns == before and np.array_equal(again.y, frames.y)
    # a press: places and tissue stay, ln F alone changes
    pressed = np.flatnonzero((frames.x[:-1, :-1] == frames.x[1:, :-1]).all(1))
    apart = frames.x[pressed + 1, -1] - frames.x[pressed, -1]
    mean = (frames.slopes[pressed, ROWS, -1] + frames.slopes[pressed + 1, ROWS, -1]).astype(float) / 2
    led = frames.y[pressed + 1, ROWS] - frames.y[pressed, ROWS]
    assert len(pressed) >= 4 and np.allclose(mean * apart, led, rtol=0.03)


def test_the_same_frames_give_the_same_emulator_and_it_comes_to_know_them(few, tmp_path):
    frames, cases, _ = few
    repeated = replace(frames, **{
        name: np.concatenate([getattr(frames, name)] * 12) for name in ("x", "y", "slopes")
    })  # fmt: skip
    one, other = (fit_plane_emulator(repeated, passes=300) for _ in range(2))
    assert all(np.array_equal(a, b) for a, b in zip(one.weights, other.weights))
    blind = fit_plane_emulator(repeated, passes=1)
    wrong, before = (errors_of(emulator, frames, cases)["rows, the median case"] for emulator in (one, blind))
    assert wrong < 5.0 < before
    write_plane_emulator(tmp_path / "plane.npz", one)
    x = frames.x.astype(float)
    assert np.allclose(read_plane_emulator(tmp_path / "plane.npz")(x)[0], one(x)[0], atol=1e-4)


def test_the_bundled_emulator_is_the_one_of_its_recipe(few):
    recipe = json.loads(plane_emulator_path().with_suffix(".recipe.json").read_text())
    assert recipe["sha256"] == file_hash(plane_emulator_path())
    assert [Block(**block) for block in recipe["cases"]] == list(BLOCKS)
    frames, cases, _ = few
    wrong = errors_of(bundled(), frames, cases)
    assert wrong["rows, the median case"] < 2 * recipe["wrong"]["rows, nine cases in ten"]


@pytest.mark.parametrize("of", [ANYWHERE, NONE], ids=lambda of: of.name)
def test_the_jacobian_is_the_misfit_s_derivative_before_and_after_the_solver_has_spoken(of):
    rng = np.random.default_rng(4)
    posterior, z = a_few_frames(of, rng)
    assert emulates(of)
    forward = EmulatedForward(of, [(len(posterior.stroke.place_mm), posterior.stroke.press)])
    check_jacobian(posterior, forward, z, rng)
    at = posterior.at["tissue"]
    for step in (0.0, 0.02):
        z[at] += step
        forward.set_right(z[at], posterior.places(z), posterior.forces(z))
        check_jacobian(posterior, forward, z, rng, within=0.05)


@pytest.mark.parametrize("of", [ANYWHERE, NONE], ids=lambda of: of.name)
def test_set_right_it_says_what_the_solver_says_and_is_as_steep(of):
    posterior, z = a_few_frames(of, np.random.default_rng(4))
    theta, places, forces = z[posterior.at["tissue"]], posterior.places(z), posterior.forces(z)
    forces[posterior.stroke.press :] *= 1 + 0.1 * (-1.0) ** np.arange(len(forces) - posterior.stroke.press)
    solver = Forward(of, MESH)
    solved = solver(theta, np.rint(places), forces)
    forward = EmulatedForward(of, [(len(places), posterior.stroke.press)])
    off = []
    for asked in (False, True):
        if asked:
            forward.set_right(theta, np.rint(places), forces)
        said = forward(theta, np.rint(places), forces)
        wrong = [
            np.sqrt(np.mean((mine - its) ** 2) / np.mean(its**2))
            for mine, its in (
                (said.images, solved.images), (said.depth, solved.depth),
                (forward.slopes(said).images[..., :4], solver.slopes(solved).images[..., :4]),
            )
        ]  # fmt: skip
        off.append(wrong)
    # the contact's nodes make single frames ripple, their derivatives most
    assert max(off[1][:2]) < 0.002 and off[1][2] < 0.1
    assert off[1][0] < off[0][0] and off[1][1] < off[0][1]


def test_of_a_fast_stroke_no_frame_need_be_where_the_sides_are_compared():
    """Frames at 1.6 and 6.6 mm: the one nearest to 4 mm was too near the lump, and there was no other."""
    places, forces = np.array([-40.0, -40.0, -25.0, -10.0, 1.6, 6.6]), np.full(6, 50.0)
    theta, forward = ANYWHERE.column("mean"), EmulatedForward(ANYWHERE, [(6, 1)])
    forward.set_right(theta, places, forces)
    solved = Forward(ANYWHERE, MESH)(theta, places, forces)
    assert np.allclose(forward(theta, places, forces).depth, solved.depth, rtol=2e-3)


def test_guesses_are_all_right_whichever_was_asked_last_and_between_them_it_is_smooth():
    posterior, z = a_few_frames(ANYWHERE, np.random.default_rng(4))
    places, forces = np.rint(posterior.places(z)), posterior.forces(z)
    first = z[posterior.at["tissue"]]
    second = first + 0.3 * ANYWHERE.column("sd")
    strokes = [(len(places), posterior.stroke.press)]
    forward, other = EmulatedForward(ANYWHERE, strokes), EmulatedForward(ANYWHERE, strokes)
    assert forward.unsure == 0.0
    forward.set_right(first, places, forces)
    right, unsure = forward(first, places, forces).images, forward.unsure
    forward.set_right(second, places, forces)
    assert 0.0 < unsure == forward.unsure, "it is of the frames that were asked first"
    other.set_right(second, places, forces)
    alone = other(second, places, forces).images
    assert np.allclose(forward(first, places, forces).images, right, rtol=1e-6)
    assert np.abs(forward(second, places, forces).images - alone).max() < 5e-3 * alone.max()
    way = second - first
    for share in (0.2, 0.5, 0.8):
        said = forward(first + share * way, places, forces)
        ends = [forward(first + (share + step) * way, places, forces).images for step in (-0.01, 0.01)]
        steep = said.slopes.images[..., :-2] @ way
        assert np.allclose((ends[1] - ends[0]) / 0.02, steep, atol=0.02 * np.abs(steep).max())


@pytest.mark.parametrize(("shape", "pitch_mm"), [((20, 26), 1.2), ((12, 16), 2.0), ((16, 26), 1.2)])
def test_an_array_with_other_rows_is_not_emulated_though_its_face_may_be_as_wide(
    monkeypatch, shape, pitch_mm
):
    assert emulates(ANYWHERE)
    monkeypatch.setattr("palpate.inversion.emulated.SHAPE", shape)
    monkeypatch.setattr("palpate.inversion.emulated.PITCH_MM", pitch_mm)
    assert not emulates(ANYWHERE)
