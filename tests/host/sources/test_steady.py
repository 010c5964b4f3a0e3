"""Times of frames that bring none: steadier than they come, and losses guessed but never made up."""

import numpy as np
import pytest

from palpate.sources.steady import Steady

PERIOD_US = 10_000.0
FRAMES = 6000


def stamped(true_us, arrived_us):
    """What comes at one moment is read at once."""
    steady, told, at = Steady(), [], 0
    while at < len(arrived_us):
        end = int(np.searchsorted(arrived_us, arrived_us[at] + 1000))
        told += steady.stamp(end - at, arrived_us[at])
        at = end
    off = np.array([time_us for time_us, _ in told]) - true_us
    return steady, off[200:] - np.median(off)


def arrivals(true_us, rng):
    """A chip that hands on what it has every 16 ms, and a computer that takes its time."""
    late = np.ceil(true_us / 16_000) * 16_000 + rng.exponential(300, len(true_us))
    return np.maximum.accumulate(late)


@pytest.mark.parametrize("seed", range(3))
def test_a_usb_chip_that_waits_16_ms_is_steadied(seed):
    rng = np.random.default_rng(seed)
    true_us = np.arange(FRAMES) * PERIOD_US * (1 + 0.01 * seed)
    arrived_us = arrivals(true_us, rng)
    steady, off = stamped(true_us, arrived_us)
    print(f"{(arrived_us - true_us).std():.0f} us as they come, {off.std():.0f} us steadied")
    assert off.std() < 0.25 * (arrived_us - true_us).std()
    assert steady.missed == 0


def test_losses_are_guessed_and_none_is_made_up():
    rng = np.random.default_rng(1)
    lost = rng.choice(np.arange(100, FRAMES - 100), 20, replace=False)
    true_us = np.delete(np.arange(FRAMES) * PERIOD_US, lost)
    steady, _ = stamped(true_us, true_us + rng.exponential(300, len(true_us)))
    assert steady.missed == 20
    steady, off = stamped(true_us, arrivals(true_us, rng))
    print(f"{steady.missed} of 20 behind a chip that waits 16 ms")
    assert 10 <= steady.missed <= 22 and np.abs(off).max() < 2 * PERIOD_US


def test_times_only_go_forward_and_survive_a_pause():
    true_us = np.arange(400) * PERIOD_US
    true_us[200:] += 5e6
    steady = Steady()
    told = np.array([steady.stamp(1, t)[0][0] for t in true_us])
    assert (np.diff(told) > 0).all()
    assert np.abs(told[210:] - true_us[210:]).max() < PERIOD_US
