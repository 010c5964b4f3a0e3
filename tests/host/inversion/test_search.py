"""A search goes down to the least misfit that the unknowns' ranges allow, and says so only there."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from palpate.inversion.classes import Class, Unknown
from palpate.inversion.posterior import Misfit
from palpate.inversion.search import search
from tests.host.inversion.toys import Nothing


class Straight:
    """Residuals A z - b of unknowns within [-1, 1], and of some more that have no ends."""

    def __init__(self, A, b, own):
        self.A, self.b, self.measured = A, b, len(b)
        self.sd = np.ones(A.shape[1])
        unknowns = tuple(Unknown(str(k), 0.0, 1.0, -1.0, 1.0, 9.0) for k in range(own))
        self.of = Class("straight", unknowns, lambda theta: None, ())
        self.at = {"tissue": slice(0, own)}

    def places(self, z):
        return z[:1]

    def forces(self, z):
        return z[:1]

    def misfit(self, z, _):
        return Misfit((self.A @ z - self.b)[None], z)

    def jacobian(self, *_):
        return self.A, np.eye(len(self.sd))


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 6), st.integers(1, 3))
def test_where_all_is_straight_a_search_ends_at_the_least_misfit_within_the_ranges(seed, own, more):
    """An unknown cut off at its end let the others go too far: a search stopped 80 above the least misfit."""
    rng = np.random.default_rng(seed)
    n = own + more
    A = rng.normal(size=(n + 3, n)) @ np.diag(np.exp(rng.normal(size=n)))
    A[:, 0] += 5 * A[:, -1]
    b = 5 * rng.normal(size=n + 3)
    ends = np.where(np.arange(n) < own, 1.0, np.inf)
    best = lsq_linear(np.vstack([A, np.eye(n)]), np.append(b, np.zeros(n)), (-ends, ends), method="bvls")
    start = np.append(rng.choice([-1.0, 0.0, 1.0], own), np.zeros(more))
    mode = search(Straight(A, b, own), Nothing(), start, 60, enough=1e-7)
    assert mode.settled
    np.testing.assert_allclose(mode.misfit.total, 2 * best.cost, rtol=1e-5)
