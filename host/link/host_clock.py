"""The host's clock for one session: Unix time when it begins, and no step after."""

from __future__ import annotations

import time

_RUNNING = getattr(time, "CLOCK_BOOTTIME", None)  # counts on while a laptop sleeps, as the probe does


def _elapsed_ns() -> int:
    return time.monotonic_ns() if _RUNNING is None else time.clock_gettime_ns(_RUNNING)


class HostClock:
    """Unix time that only grows: a step of the computer's clock would shift the probe's by whole turns."""

    def __init__(self) -> None:
        self._ahead_ns = time.time_ns() - _elapsed_ns()

    def now_ns(self) -> int:
        """Unix time, ns, as if the computer's clock had not been set since this session began."""
        return self._ahead_ns + _elapsed_ns()
