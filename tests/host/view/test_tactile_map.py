"""The page's tactile map while a stroke runs."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.features.gaussian import bump
from palpate.stroke.tactile_map import columns_over_lump, fit_growing_map, method_2
from palpate.wire.cells import ROW_MM


@given(
    base=st.floats(1, 10), amp=st.floats(0.3, 5), centre=st.floats(-8, 8), stdev=st.floats(3, 8),
)  # fmt: skip
def test_a_whole_strokes_map_gives_its_gaussian_back(base, amp, centre, stdev):
    position = np.linspace(-40, 40, 161)
    place = position[:, None] + ROW_MM[None, :]
    rows = bump(place, base, amp, centre, stdev)
    x, p, covered = method_2(position, rows)
    whole = covered == 16
    fit = fit_growing_map(x[whole], p[whole])
    assert fit is not None
    assert fit.base_kPa == pytest.approx(base, rel=0.01)
    assert fit.amp_kPa == pytest.approx(amp, rel=0.02)
    assert fit.centre_mm == pytest.approx(centre, abs=0.05)
    assert fit.stdev_mm == pytest.approx(stdev, rel=0.03)


def test_where_only_part_of_the_face_has_been_the_face_itself_leaves_no_mark():
    position = np.linspace(-20, 20, 81)
    face = 1.0 - 0.4 * (ROW_MM / 12.0) ** 2
    _, p, _ = method_2(position, np.tile(4.0 * face, (81, 1)))
    assert np.ptp(p) < 1e-9


@pytest.mark.parametrize("n", [0, 1, 2])
def test_a_stroke_that_has_hardly_begun_has_no_map_and_no_fit(n):
    x, p, _ = method_2(np.zeros(n), np.ones((n, 16)))
    assert x.size == p.size == 0 and fit_growing_map(x, p) is None


def test_noise_alone_gets_no_fit():
    rng = np.random.default_rng(5)
    x = np.arange(-30.0, 31.0)
    found = [fit_growing_map(x, 4 + rng.normal(0, 0.01, x.size)) for _ in range(40)]
    assert sum(f is not None for f in found) <= 4


def test_a_ball_is_looked_at_through_the_columns_over_it():
    position = np.linspace(-30, 30, 41)
    along = np.exp(-0.5 * ((position[:, None] + ROW_MM[None, :]) / 4.6) ** 2)
    across = np.exp(-0.5 * ((np.arange(26) - 18) / 2.6) ** 2)
    used = columns_over_lump(4.0 + 1.0 * along[:, :, None] * across[None, None, :])
    assert used.min() >= 13 and used.max() <= 23 and 18 in used
    assert columns_over_lump(np.full((41, 16, 26), 4.0)).size == 26
