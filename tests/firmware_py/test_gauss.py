"""The integer fit finds what least squares in float64 finds."""

from array import array

import numpy as np
import pytest

from firmware_py import gauss, gaussfit, search
from palpate.firmware_twin.replay_core import compiled
from tests.firmware_py import checked_int
from tests.firmware_py.pipeline_features import fit_like_firmware

UNITS_PER_KPA = 2048 / 6105e-6
X = np.arange(-28.0, 29.0)


def noisy_maps(n, seed=1):
    """Bumps of every size that counts as a lump, on maps with the noise of a typical sensor."""
    rng = np.random.default_rng(seed)
    for _ in range(n):
        base = rng.uniform(0.8, 8)
        amp = base * np.exp(rng.uniform(np.log(0.02), np.log(0.8)))
        stdev = rng.uniform(2.5, 12)
        centre = rng.uniform(-5, 5)
        noise = np.exp(rng.uniform(np.log(0.0005), np.log(0.006)))
        yield base + amp * np.exp(-(((X - centre) / stdev) ** 2) / 2) + noise * rng.standard_normal(57)


def integers(y):
    return array("i", [round(v * UNITS_PER_KPA) for v in y])


class Fitter:
    """The firmware's search and fit, with its working space."""

    def __init__(self, modules):
        self.modules = modules
        self.p, self.best, self.keep = (array("i", bytes(20)) for _ in range(3))
        self.work, self.s, self.d = array("i", bytes(1024)), array("i", bytes(64)), array("i", bytes(12))

    def __call__(self, y):
        m = self.modules
        if not m.search.search(y, len(y), 14, 42, self.work, self.best, self.d):
            return None
        place, width = self.best[0], self.best[1]
        if not m.gaussfit.fit_from(
            y, len(y), self.p, self.best, self.work, self.s, self.d, place, width, self.keep
        ):
            return None
        return list(self.p)


class Plain:
    gaussfit, search = gaussfit, search


def test_within_1e_3_of_least_squares_on_1000_noisy_maps_and_no_failure():
    fitter = Fitter(compiled())
    worst = 0.0
    for y in noisy_maps(1000):
        counts = integers(y)
        got = fitter(counts)
        assert got is not None
        error = 1.0
        # one start is enough where both end in the same place
        for widths in ((6.0,), (3.0, 6.0, 12.0)):
            if error > 1e-3:
                true = fit_like_firmware(np.array(counts) / UNITS_PER_KPA, widths_mm=widths)
                amp = got[gauss.AMP] / UNITS_PER_KPA / true.amp - 1
                error = max(abs(amp), abs(got[gauss.STDEV] / 65536 / true.stdev - 1))
        worst = max(worst, error)
    assert worst < 1e-3


def test_centre_and_base_too():
    fitter = Fitter(compiled())
    for y in noisy_maps(50, seed=2):
        counts = integers(y)
        got, true = fitter(counts), fit_like_firmware(np.array(counts) / UNITS_PER_KPA)
        assert got[gauss.CENTRE] / 65536 - 28 == pytest.approx(true.centre, abs=2e-3 * true.stdev)
        assert got[gauss.BASE] / UNITS_PER_KPA == pytest.approx(true.base, rel=2e-4)
        rms = np.exp(got[gauss.COST] / 2**25) / np.sqrt(57) / UNITS_PER_KPA
        assert rms == pytest.approx(true.rms, rel=2e-2)


def test_the_same_integers_on_cpython_compiled_and_watched():
    watched, _ = checked_int.load()
    fast, plain, slow = Fitter(compiled()), Fitter(Plain), Fitter(watched)
    for y in noisy_maps(20, seed=3):
        counts = integers(y)
        assert fast(counts) == plain(counts) == slow(counts)


@pytest.mark.parametrize(
    "y",
    [
        np.zeros(57, int),
        np.full(57, 1000),
        np.linspace(0, 8_000_000, 57).astype(int),
        np.where(np.arange(57) == 28, 8_386_560, -8_386_560),
        np.where(np.arange(57) % 2, 8_386_560, 0),
        -np.exp(-((np.arange(57) - 28) ** 2) / 50) * 8e6,
        np.arange(57) % 3,
    ],
    ids=["zero", "flat", "ramp", "spike", "comb", "dip", "ripple of one unit"],
)
def test_no_map_brings_it_out_of_range(y):
    watched, _ = checked_int.load()
    counts = checked_int.ints(y)
    got = Fitter(watched)(counts)
    if got is not None:
        assert gauss.MIN_STDEV <= got[gauss.STDEV] <= gauss.MAX_STDEV
        assert got[gauss.AMP] >= 0


def test_random_garbage_stays_in_range():
    watched, _ = checked_int.load()
    fitter = Fitter(watched)
    rng = np.random.default_rng(5)
    for k in range(12):
        size = 2 ** rng.integers(1, 23)
        y = rng.integers(-size, size + 1, 57)
        if k % 2:
            y = np.cumsum(y) // 57
        fitter(checked_int.ints(y))
