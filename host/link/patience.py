"""How long to wait for an answer before a command is sent again, learned from earlier answers."""

from __future__ import annotations

FIRST_WAIT_S, SHORTEST_WAIT_S = 0.4, 0.03
"""How long to wait for an answer before sending again: at first, and on a quick line."""
GROWTH, MOST_GROWTH = 1.4, 4.0
SMOOTHING = 0.2
"""Weight of a new round trip in the running mean."""


class Patience:
    """Waits four times the usual round trip before a command is sent again, within two bounds."""

    def __init__(self) -> None:
        self._trip_s = FIRST_WAIT_S / 4
        self.wait_s = FIRST_WAIT_S
        """How long to wait after the first sending, s."""

    def learn(self, trip_s: float) -> None:
        """Take a round trip into account.

        After a repetition it seems too short (the answer may be to the first sending); that costs a few more
        repetitions on a slow line, where taking none into account would never learn on a lossy one.
        """
        self._trip_s += SMOOTHING * (trip_s - self._trip_s)
        self.wait_s = min(max(SHORTEST_WAIT_S, 4 * self._trip_s), FIRST_WAIT_S)

    def longer(self, waited_s: float) -> float:
        """How long to wait after the next sending, when `waited_s` brought no answer.

        Every command is idempotent, so a lost one may be sent again soon; the wait grows each time.
        """
        return min(GROWTH * waited_s, MOST_GROWTH * self.wait_s, FIRST_WAIT_S)
