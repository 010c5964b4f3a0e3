"""The probe's clock seen from the host: unwrapped, with offset and drift, each with its uncertainty.

Units: microseconds; drift in parts per million (the probe's clock gains when it is positive).
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

WRAP = 1 << 30
"""The probe counts microseconds modulo 2^30 (17.9 minutes)."""


class Unwrapper:
    """Turns a counter modulo 2^30 us into one that keeps growing, even where values come late or out of
    order.

    The host's clock helps through long silences: a value belongs to the turn nearest to what is expected.
    """

    def __init__(self) -> None:
        self._last: int | None = None
        self._last_host_us = 0

    def __call__(self, value: int, host_us: int | None = None) -> int:
        """The unwrapped value.

        Parameters
        ----------
        value : int
            The counter, 0 to 2^30 - 1.
        host_us : int, optional
            When it came, on the host's clock; without it silences over 8.9 minutes cannot be bridged.
        """
        if self._last is None:
            self._last, self._last_host_us = value, host_us or 0
            return value
        expected = self._last
        if host_us is not None:
            expected += max(0, host_us - self._last_host_us)
        unwrapped = expected + (value - expected + WRAP // 2) % WRAP - WRAP // 2
        if unwrapped > self._last:
            self._last, self._last_host_us = unwrapped, host_us or 0
        return unwrapped


@dataclass(frozen=True)
class ClockState:
    """What is known of the probe's clock.

    Parameters
    ----------
    offset_us : float
        Host time (Unix) minus probe time, us, at `at_probe_us`.
    drift_ppm : float
        Rate of the probe's clock against the host's, minus 1, in ppm.
    uncertainty_us : float
        Half the shortest round trip: the true offset is within this of `offset_us`, whatever the asymmetry.
    exchanges : int
        Exchanges that this is based on.
    at_probe_us : float
        The probe's (unwrapped) time for which the offset holds.
    """

    offset_us: float
    drift_ppm: float
    uncertainty_us: float
    exchanges: int
    at_probe_us: float = 0.0


class ClockSync:
    """Offset and drift from time exchanges: Cristian's midpoint, a line through the quickest ones.

    A round trip bounds the error of its midpoint by half its length, so only exchanges within 1.5 times the
    shortest round trip count; the drift needs them spread over `min_span_s`. `times_slower` (an emulated
    board's clock) tells in which of the probe's turns a value lies.

    Source: F. Cristian, "Probabilistic clock synchronization", Distributed Computing 3 (1989).
    """

    def __init__(self, keep: int = 64, min_span_s: float = 5.0, times_slower: float = 1.0) -> None:
        self._exchanges: deque[tuple[float, float, float]] = deque(maxlen=keep)
        self._unwrap = Unwrapper()
        self._min_span_us = 1e6 * min_span_s
        self._times_slower = times_slower

    def add(self, asked_us: float, taken_us: int, answered_us: int, came_us: float) -> None:
        """One exchange of four stamps, us.

        Parameters
        ----------
        asked_us, came_us : float
            When the request left and its answer arrived, on the host's clock.
        taken_us, answered_us : int
            When the probe received the request and wrote the answer, on its clock modulo 2^30.
        """
        taken = self._unwrap(taken_us, int(came_us / self._times_slower))
        spent = (answered_us - taken_us) % WRAP
        trip = came_us - asked_us - spent
        self._exchanges.append(((asked_us + came_us) / 2, taken + spent / 2, max(trip, 0.0)))

    def restart(self) -> None:
        """Forget everything: the probe's clock has restarted."""
        self._exchanges.clear()
        self._unwrap = Unwrapper()

    @property
    def state(self) -> ClockState | None:
        """The present estimate, or None before the first exchange."""
        if not self._exchanges:
            return None
        shortest = min(trip for _, _, trip in self._exchanges)
        good = [(host, probe) for host, probe, trip in self._exchanges if trip <= 1.5 * shortest + 50.0]
        host_last, probe_last = good[-1]
        span = good[-1][1] - good[0][1]
        slope = 1.0
        if len(good) >= 3 and span >= self._min_span_us:
            n = len(good)
            mean_host = sum(h - host_last for h, _ in good) / n
            mean_probe = sum(p - probe_last for _, p in good) / n
            above = sum((h - host_last - mean_host) * (p - probe_last - mean_probe) for h, p in good)
            below = sum((p - probe_last - mean_probe) ** 2 for _, p in good)
            slope = above / below
            offset = host_last + mean_host - slope * mean_probe - probe_last
        else:
            best_host, probe_last, _ = min(self._exchanges, key=lambda exchange: exchange[2])
            offset = best_host - probe_last
        return ClockState(offset, (1.0 / slope - 1.0) * 1e6, shortest / 2, len(good), probe_last)

    def host_time_us(self, probe_us: int) -> float | None:
        """Host (Unix) time of an unwrapped probe time, us; None before the first exchange."""
        state = self.state
        if state is None:
            return None
        since = probe_us - state.at_probe_us
        return probe_us + state.offset_us - since * state.drift_ppm * 1e-6
