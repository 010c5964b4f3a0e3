"""Times for frames that bring none: when they came, without what USB and this computer's scheduler added.

A straight line through the arrivals, whose memory grows to forty frames and then fades; losses are guessed
from frames that stay late. Source of the gains: the alpha-beta filter of expanding, then of fading memory
(E. Brookner, Tracking and Kalman Filtering Made Easy). Units: us.
"""

from __future__ import annotations

from collections import deque

ALPHA = 0.05
"""Least weight of a frame's lateness in the time."""
BETA = ALPHA**2 / (2 - ALPHA)
"""The same in the period."""
SETTLED = 20
"""Frames after which the period is believed."""
LATE = 0.6
"""Of a period: so late must `CONFIRM` frames running be until the one before them counts as lost."""
CONFIRM = 4


class Steady:
    """Stamps frames and guesses how many never came.

    Attributes
    ----------
    period_us : float
        Of the frames, as far as it is known; 0 at first.
    missed : int
        Frames that seem to have been lost: the array counts none, so nobody can know.
    """

    def __init__(self) -> None:
        self.period_us = 0.0
        self.missed = 0
        self._last_us = 0.0
        self._frames = 0
        self._late: deque[float] = deque(maxlen=CONFIRM)

    def stamp(self, frames: int, arrived_us: float) -> list[tuple[float, int]]:
        """Times of some frames that were read at once: of each, us, and how many were lost before it."""
        return [self._one(arrived_us - (frames - 1 - k) * self.period_us) for k in range(frames)]

    def _one(self, arrived_us: float) -> tuple[float, int]:
        self._frames += 1
        n = self._frames
        if n <= 2:
            self.period_us = max(arrived_us - self._last_us, 1.0) if n == 2 else 0.0
            self._last_us = max(arrived_us, self._last_us)
            return self._last_us, 0
        due_us = self._last_us + self.period_us
        late_us, missed = arrived_us - due_us, 0
        self._late.append(late_us)
        if n > SETTLED and len(self._late) == CONFIRM and min(self._late) > LATE * self.period_us:
            missed = round(min(self._late) / self.period_us)
            self.missed += missed
            due_us += missed * self.period_us
            late_us -= missed * self.period_us
            self._late.clear()
        elif n > SETTLED:
            # what is late by chance must not pull the line, nor what follows a loss that is not certain yet
            late_us = min(max(late_us, -self.period_us), self.period_us)
        alpha = max(ALPHA, 2 * (2 * n - 1) / (n * (n + 1)))
        beta = max(BETA, 6 / (n * (n + 1)))
        self._last_us = max(due_us + alpha * late_us, self._last_us + 1)
        self.period_us = max(self.period_us + beta * late_us, 1.0)
        return self._last_us, missed
