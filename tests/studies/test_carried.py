"""Images are carried over to another mesh by what lumps computed on both tell."""

import numpy as np

from tests.studies.carried import HALF, Halves, errors, learn


def made_up(n, seed):
    """Smooth halves that differ in pressure, slope along and bend across, and what a coarser edge makes of
    them."""
    rng = np.random.default_rng(seed)
    along, across = np.linspace(-1, 1, 16)[:, None], np.linspace(1, 0, HALF)
    high, tilt, bend, depth = rng.uniform((2, -0.3, 0, 2), (6, 0.3, 0.4, 3), (n, 4)).T
    fine = np.tile(
        high[:, None, None] * (1 + tilt[:, None, None] * along - bend[:, None, None] * across**2), (2, 1, 1)
    )
    coarse = fine.copy()
    coarse[:, :, 0] *= np.tile(0.75 + 0.1 * bend, 2)[:, None]

    def halves(kPa, depth_mm):
        return Halves(
            kPa, np.tile(high, 2), np.tile(depth_mm, 2), np.full(2 * n, 5.0), np.tile(np.arange(n) // 3, 2)
        )

    return halves(coarse, depth), halves(fine, 1.002 * depth)


def test_lumps_that_were_not_computed_anew_come_near_to_what_that_would_give():
    old, new = made_up(150, 1)
    told = errors(old, new)
    assert told["edge_after"] < 0.1 * told["edge_before"]
    assert told["displacement_after"] < 0.1 * told["displacement_before"]
    fresh_old, fresh_new = made_up(30, 2)
    kPa, depth_mm = learn(old, new).carried(fresh_old)
    np.testing.assert_allclose(kPa, fresh_new.kPa, rtol=0.03)
    np.testing.assert_allclose(depth_mm, fresh_new.displacement_mm, rtol=1e-3)
