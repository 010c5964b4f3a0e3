"""Two visits to one lump: what they share drops out, and what has changed is told with its own interval."""

import numpy as np

from palpate.inversion.classes import ANYWHERE
from palpate.inversion.forward import COARSE
from palpate.inversion.joint import Together
from palpate.inversion.visits import TwoVisits, _changing
from tests.host.inversion.test_inversion import a_few_frames, check_jacobian


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

    check_jacobian(both, forward, z, rng)
