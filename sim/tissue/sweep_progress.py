"""How far a sweep is."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Progress:
    """How far a sweep is: cases done (of which reused and failed) of a total, rate and seconds left."""

    done: int
    total: int
    reused: int
    failed: int
    rate_per_s: float
    left_s: float


class Reporter:
    """Counts, and calls back a few times a second."""

    def __init__(self, total: int, reused: int, progress: Callable[[Progress], None] | None) -> None:
        self.total, self.reused, self.progress = total, reused, progress
        self.computed = self.failed = 0
        self.began = self.shown = time.monotonic()

    def count(self, failed: bool) -> None:
        self.computed += 1
        self.failed += failed
        if time.monotonic() - self.shown > 0.2:
            self.show()

    def show(self) -> None:
        if self.progress is None:
            return
        self.shown = time.monotonic()
        rate = self.computed / max(self.shown - self.began, 1e-9)
        left = self.total - self.reused - self.computed
        left_s = left / rate if rate > 0 else 0.0
        self.progress(
            Progress(self.reused + self.computed, self.total, self.reused, self.failed, rate, left_s)
        )
