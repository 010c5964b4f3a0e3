"""Two visits to one lump: what they share drops out, and what has changed is told with its own interval."""

import numpy as np

from palpate.inversion.classes import ANYWHERE
from palpate.inversion.forward import COARSE
from palpate.inversion.joint import Together
from palpate.inversion.visits import TwoVisits, _changing
from tests.host.inversion.test_inversion import a_few_frames


def test_the_jacobian_of_two_visits_is_their_misfit_s_derivative():
    """Of tissue that both share, of the change that only the second feels, and of gains in common."""
    rng = np.random.default_rng(7)
    of = _changing(ANYWHERE)
    parts, own = zip(*(a_few_frames(of, rng) for _ in range(2)))
    both = Together(parts, ("gain",))
    forward = TwoVisits(of, ANYWHERE, COARSE, parts[0], len(parts[0].stroke.place_mm))
    z = both.joined(own)
    z[both.at["tissue"]][-2:] = 0.1, -0.05
    assert both.size == 2 * parts[0].size - len(of.unknowns) - 1 - 16

    def computed(z):
        return forward(z[both.at["tissue"]], both.places(z), both.forces(z))

    found = computed(z)
    A, B = both.jacobian(z, found, forward.slopes(found))
    step = 2e-4 * np.minimum(both.sd, 3.0) * rng.standard_normal(both.size)
    forces = ~np.isfinite(both.sd)
    step[forces] = 2e-4 * rng.standard_normal(forces.sum())
    ends = [both.misfit(z + sign * step, computed(z + sign * step)) for sign in (-1, 1)]
    difference = (ends[1].data - ends[0].data).ravel() / 2
    assert np.abs(A @ step - difference).max() < 0.02 * np.abs(difference).max()
    assert np.allclose(B @ step, (ends[1].prior - ends[0].prior) / 2)
