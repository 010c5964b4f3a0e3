"""How old a frame is when it arrives: the link's latency as it is, not as a round trip suggests."""

from __future__ import annotations

import math
import statistics
import time
from collections import deque

from palpate.errors import LinkError
from palpate.link.probe import Probe
from palpate.wire.clock import WRAP
from palpate.wire.events import Frame

SYNC_EVERY_S = 20.0


class Latency:
    """From the scan of a frame to its arrival here, on the probe's clock as the host sees it."""

    def __init__(self) -> None:
        self._offset_us: float | None = None
        self._synced = -math.inf
        self._ages_ms: deque[float] = deque(maxlen=64)

    def sync(self, probe: Probe) -> None:
        """Compare the clocks again if that was long ago; an emulated board's go apart too fast for it."""
        if probe.times_slower > 1:
            return
        if time.monotonic() - self._synced < SYNC_EVERY_S:
            return
        self._synced = time.monotonic()
        try:
            self._offset_us = probe.sync_clock(exchanges=3).offset_us
        except LinkError:
            self._offset_us = None

    def add(self, frame: Frame) -> None:
        """Take a frame's two times (the probe's is modulo 2^30 us at the root of both)."""
        if self._offset_us is not None:
            age_us = frame.host_ns / 1000 - self._offset_us - frame.time_us
            age_us = (age_us + WRAP / 2) % WRAP - WRAP / 2
            self._ages_ms.append(max(age_us, 0.0) / 1000)

    def restart(self) -> None:
        """The link broke; the probe may have been reset."""
        self._offset_us, self._synced = None, -math.inf
        self._ages_ms.clear()

    @property
    def median_ms(self) -> float | None:
        """Of the last frames; None as long as there is none."""
        return statistics.median(self._ages_ms) if self._ages_ms else None
