"""Frames are read where the face stands alike on the mesh, so their slope by place has no ripple."""

import numpy as np
import pytest

from palpate.inversion.classes import ANYWHERE
from palpate.inversion.forward import COARSE, FINE, Forward
from palpate.inversion.track import nodes_mm, side_by_side, track

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


@pytest.mark.parametrize("settings", [COARSE, FINE])
def test_between_places_they_are_what_the_solver_says_there(settings):
    """At the nodes to rounding; midway on the fine mesh to .2 % of the pressure."""
    _, force = a_stroke(np.random.default_rng(2))
    nodes = nodes_mm(settings.hx_mm)
    there = nodes = nodes[np.abs(nodes) < 37]
    if settings is FINE:
        there = np.append(there, [-17.0, -15.0, -13.0, -11.0, 11.0, 13.0, 15.0, 17.0])
    steady = np.full(len(there) + 1, force[-1])
    solved = Forward(ANYWHERE, settings)(THETA, there, steady[1:])
    read = Forward(ANYWHERE, settings, strokes=[(len(steady), 1)])(THETA, np.append(-37.0, there), steady)
    apart = np.abs(read.images[1:] - solved.images).max(1)
    assert apart[: len(nodes)].max() < 1e-5
    assert apart.max() < 2e-3 * solved.images.max()
    assert np.abs(read.depth[1:] - solved.depth).max() < 1e-3


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
