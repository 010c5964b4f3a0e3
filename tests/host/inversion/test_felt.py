"""Of a stroke the inversion takes some frames, and means of others; what lags behind is of all."""

import numpy as np
import pytest

from palpate.inversion.felt import felt_stroke
from palpate.sim.probe.creep import Lag
from tests.host.inversion.test_inversion import frames

PRESS = 24


@pytest.fixture
def stroke():
    """A press, and a stroke over a bump, without noise."""
    n = 74
    place = np.concatenate([np.zeros(PRESS), 1.5 * np.arange(n - PRESS)])
    rows = np.exp(-(((place[:, None] - 38 + 1.5 * np.arange(16)) / 6) ** 2)) + 2.0
    pressure = (
        np.repeat(rows[:, :, None], 26, 2) * np.minimum(1.0, np.arange(1, n + 1) / PRESS)[:, None, None]
    )
    return felt_stroke(**frames(
        n, pressure_kPa=pressure, place_mm=place, displacement_mm=pressure.mean((1, 2)), press=PRESS
    ))  # fmt: skip


def test_what_lags_behind_is_as_the_sensor_has_it(stroke):
    clock = np.concatenate([60 / 37.5 * np.arange(-PRESS, 0), stroke.place_mm[PRESS:]])
    sensor = Lag().follow(stroke.rows_kPa[:, :, None], clock)[..., 0]
    assert np.allclose(stroke.slow(stroke.rows_kPa), sensor)


def test_of_some_frames_and_means_it_is_what_the_whole_stroke_s_is(stroke):
    """They had lagged as if there were no frames between them: in a press by a tenth of a kPa."""
    press, groups = np.arange(2, PRESS, 3), np.array_split(np.arange(50), 17)
    whole = stroke.slow(stroke.rows_kPa)
    taken = stroke.means(press[:, None], groups)
    expected = np.concatenate([whole[press], [whole[PRESS + group].mean(0) for group in groups]])
    behind = np.abs(expected - taken.rows_kPa).max()
    assert np.abs(taken.slow(taken.rows_kPa) - expected).max() < 0.03 * behind


def test_a_mean_has_its_frames_place_pressure_and_displacement(stroke):
    taken = stroke.means(np.array([[4], [9]]), [np.array([0, 1, 2]), np.array([3])])
    assert taken.press == 2 and taken.each.tolist() == [1, 1, 3, 1]
    for name in ("rows_kPa", "place_mm", "displacement_mm", "share"):
        every = getattr(stroke, name)
        assert np.allclose(getattr(taken, name)[2], every[PRESS : PRESS + 3].mean(0))
        assert np.allclose(getattr(taken, name)[[0, 1, 3]], every[[4, 9, PRESS + 3]])
