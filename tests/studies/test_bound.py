"""The bound of what a stroke tells: it grows with the noise, and shrinks with what is told."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.sim.probe.noise import LEVELS
from palpate.sim.tissue import Case, Stroke
from palpate.sim.tissue.any_tissue import STROKES
from palpate.sim.tissue.face_sensors import SENSORS_MM
from tests.studies.bound import PRESS_SHARES, Bound, computed_bound, neighbours

CASE = Case(10.0, 0.6, 10.0, 0.6, fat_mm=12.0, gland_mm=20.0, fat_stiffening=1.0, gland_stiffening=1.0)


def felt(case, positions):
    """A made-up stroke: a bump on a base, each a smooth function of everything, the border's among them."""
    F, fat, ratio = case.F_N_per_m, case.fat_kPa, case.gland_ratio
    reach = F / fat
    x = positions[:, None] + SENSORS_MM
    base = (
        F / (30 + 3 * reach**0.6 + case.fat_mm / 9 + 0.1 * case.fat_stiffening) * (1 - (SENSORS_MM / 16) ** 2)
    )
    wide = 0.3 * case.d_mm + 0.4 * case.depth_mm + 0.2 * case.gland_stiffening
    bump = case.d_mm / case.depth_mm * (1.1 - case.E_inv23) * np.exp(-((x / wide) ** 2) / 2)
    image = base * (1 + 0.2 * bump + 0.02 * case.probe_radius_mm / 40)
    depth = reach**0.6 * (case.fat_mm + case.gland_mm / ratio) ** 0.7 / 5 * (1 - 0.1 * bump[:, 8])
    n = len(positions)
    nothing = np.zeros(n)
    return Stroke(case, positions, depth, image, nothing, nothing, np.zeros((n, 2)), nothing, nothing + 1,
                  np.zeros(n, int), 0, 0, 0.0)  # fmt: skip


def everything_felt():
    found = {}
    for near in neighbours(CASE):
        found[near] = felt(near, STROKES.positions_mm())
        for share in PRESS_SHARES:
            press = replace(near, F_rel=near.F_rel * share)
            found[press] = felt(press, np.array([-40.0]))
    return found


def test_the_maps_bound_grows_with_the_noise_and_shrinks_with_what_is_told():
    found = everything_felt()
    typical, good = (computed_bound(CASE, found, level) for level in ("typical", "good"))
    assert isinstance(typical, Bound)
    assert isinstance(good, Bound)
    for name in typical.names:
        assert good.sd(name) <= typical.sd(name) * (1 + 1e-9)
        assert typical.told("E^-2/3").sd(name) <= typical.sd(name) * (1 + 1e-9)
    assert typical.told("ln d").sd("ln d") == pytest.approx(0, abs=1e-6)
    sd = typical.combined()[1]
    assert sd <= typical.sd("ln d")
    assert sd == pytest.approx(typical.told("E^-2/3").sd("ln d"), rel=1e-3)
    # Whatever the map says, nobody knows less than the design's spread tells.
    deaf = computed_bound(CASE, found, LEVELS["typical"].with_(white=100.0, displacement_noise_mm=900.0))
    assert isinstance(deaf, Bound)
    assert deaf.sd("ln d") == pytest.approx(0.40, rel=0.01)


def test_a_lump_with_a_neighbour_that_could_not_be_computed_has_no_bound():
    found = everything_felt()
    del found[neighbours(CASE)[5]]
    assert computed_bound(CASE, found, "typical") is None
