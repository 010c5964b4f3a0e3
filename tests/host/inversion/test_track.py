"""Frames are read where the face stands alike on the mesh, so their slope by place has no ripple."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.inversion.classes import ANYWHERE
from palpate.inversion.forward import COARSE, FINE, Forward
from palpate.inversion.track import side_by_side, track

THETA = ANYWHERE.column("mean")


def a_stroke(rng, press=3):
    """Places and forces of a press and a stroke; the hand's force wanders."""
    place = np.concatenate([np.full(press, -37.0), np.arange(-37.0, 38.0, 2.0)])
    force = 50 * np.exp(0.05 * np.sin(place / 9 + rng.uniform(0, 6)))
    force[:press] *= np.linspace(0.4, 0.9, press)
    return place, force


def test_what_frames_say_of_their_place_is_no_ripple_of_the_mesh():
    """Solved frame by frame, the derivative was off by more than itself over .3 mm; searches stalled."""
    place, force = a_stroke(np.random.default_rng(1))
    forward = Forward(ANYWHERE, COARSE, strokes=[(len(place), 3)])
    slopes = forward.slopes(forward(THETA, place, force))
    ends = [forward(THETA, place + sign * 0.3, force) for sign in (-1, 1)]
    difference = (ends[1].images - ends[0].images) / 0.6
    apart = slopes.images[:, :, -2] - difference
    assert np.linalg.norm(apart) < 0.05 * np.linalg.norm(difference)


@pytest.mark.parametrize(("settings", "moved_mm"), [(COARSE, 0.0), (FINE, 1.0)])
def test_between_places_they_are_what_the_solver_says_there(settings, moved_mm):
    """At the nodes to rounding; midway on the fine mesh to .2 % of the pressure."""
    settings = replace(settings, tolerance=1e-7)
    place, force = a_stroke(np.random.default_rng(2), press=1)
    there, steady = np.rint(place / 2) * 2, np.full(len(place), force[-1])
    forward = Forward(ANYWHERE, settings, strokes=[(len(place), 1)])
    forward(THETA, there, steady)
    read = forward(THETA, there + moved_mm, steady)
    solved = Forward(ANYWHERE, settings)(THETA, there[1:] + moved_mm, steady[1:])
    apart = np.abs(read.images[1:] - solved.images).max()
    assert apart < (2e-3 * solved.images.max() if moved_mm else 1e-5)
    assert np.abs(read.depth[1:] - solved.depth).max() < 1e-3


def test_where_the_hand_presses_harder_for_a_moment_the_solver_is_asked_with_that_force():
    """Places 4 mm apart, whatever the frames, had cost a chi2 of 15 where the force went up between them."""
    place, force = a_stroke(np.random.default_rng(5))
    force[10] *= 1.2
    on = track(place + 0.3, force, 3, 1.0)
    assert np.abs(on.apart).max() < 0.05


def test_each_stroke_has_its_own_forces_and_a_press_its_place():
    rng = np.random.default_rng(3)
    one, other = a_stroke(rng), a_stroke(rng)
    both = side_by_side([track(*one, 3, 1.0), track(one[0], 2 * other[1], 3, 1.0)])
    n, m = len(one[0]), len(both.places_mm) // 2
    assert not both.shares[:n, m:].any() and not both.shares[n:, :m].any()
    assert np.ptp(both.places_mm[m - 3 : m]) == 0
    assert np.allclose(both.forces_N_per_m[m - 3 : m], one[1][:3])
    known = np.log(both.forces_N_per_m)[:, None]
    assert np.allclose(both.frames(known, np.ones_like(known))[3:n, 0], np.log(one[1][3:]))


def test_places_stay_while_a_search_moves_the_lump_a_little():
    place, force = a_stroke(np.random.default_rng(4))
    first = track(place, force, 3, 2.0)
    assert np.array_equal(track(place + 0.4, force, 3, 2.0, first).places_mm, first.places_mm)
    assert track(place + 9.0, force, 3, 2.0, first).places_mm.max() > first.places_mm.max()
