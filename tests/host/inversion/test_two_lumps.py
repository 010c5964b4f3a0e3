"""Two lumps are told as two, each with its size."""

import numpy as np
import pytest

from palpate.inversion.classes import ANYWHERE, APART
from palpate.inversion.departures import TWO_LUMPS
from palpate.inversion.strokes import invert_stroke
from palpate.inversion.two_lumps import TwoForward, two_of
from palpate.inversion.under import emulated_of
from palpate.sim.probe.noise import LEVELS
from palpate.sim.tissue import Case
from tests.host.inversion.test_inversion import a_few_frames, check_jacobian
from tests.host.inversion.world import TwoAlike, felt_of
from tests.studies.inverted import lumps

TWO = two_of(ANYWHERE)


def frames_of(of):
    """A guess, its posterior, and its forward model."""
    posterior, z = a_few_frames(of, np.random.default_rng(4))
    alone = emulated_of(ANYWHERE, [posterior.stroke])
    return posterior, z, TwoForward(of, alone) if of is TWO else alone


def test_the_jacobian_is_the_misfit_s_derivative_before_and_after_the_solver_has_spoken():
    posterior, z, forward = frames_of(TWO)
    rng = np.random.default_rng(4)
    check_jacobian(posterior, forward, z, rng)
    at = posterior.at["tissue"]
    for step in (0.0, 0.02):
        z[at] += step
        forward.set_right(z[at], posterior.places(z), posterior.forces(z))
        check_jacobian(posterior, forward, z, rng, within=0.05)


def test_a_second_lump_far_away_is_not_felt():
    posterior, z, two = frames_of(TWO)
    theta = z[posterior.at["tissue"]]
    theta[[unknown.name for unknown in TWO.unknowns].index(APART)] = 80.0
    posterior_of_one, z_of_one, one = frames_of(ANYWHERE)
    places, forces = posterior.places(z), posterior.forces(z)
    alone = one(z_of_one[posterior_of_one.at["tissue"]], places, forces)
    both = two(theta, places, forces)
    assert np.abs(both.images - alone.images).max() < 1e-9 * alone.images.max()
    assert np.abs(both.depth - alone.depth).max() < 1e-9


@pytest.mark.long
def test_two_lumps_14_mm_apart_are_told_as_two_with_their_sizes():
    case = Case(9.0, 0.7, 8.0, 0.55, fat_stiffening=1.0, gland_stiffening=1.0)
    felt, start, _, _ = felt_of(case, 5, field=TwoAlike(case, 14.0))
    found = invert_stroke(felt, start, LEVELS["typical"])
    assert found.kind == TWO_LUMPS and found.classes[TWO_LUMPS] > 0.9 and found.fits
    assert found.values["d_mm"].value == pytest.approx(9.0, rel=0.2)
    assert found.values["d2_mm"].value == pytest.approx(9.0, rel=0.2)
    assert found.values["apart_mm"].value == pytest.approx(14.0, abs=1.0)
    alone = invert_stroke(felt, start, LEVELS["typical"], ANYWHERE.name)
    assert not alone.fits and "a second lump" in alone.why


@pytest.mark.long
def test_one_lump_is_not_taken_for_two_where_what_is_left_looks_like_a_second():
    """To first order the odds of two lumps were e^13 here, though no two explain the stroke as one does."""
    felt, start, _, _ = felt_of(lumps(8, 92)[7], 92007)
    found = invert_stroke(felt, start, LEVELS["typical"], ANYWHERE.name)
    assert found.fits and found.classes[TWO_LUMPS] < 0.1
