"""What a stroke is at now: the probe tells changes (contact, started, ended), people want to see what is."""

from __future__ import annotations

from dataclasses import dataclass, replace

from palpate.wire.events import StrokeState

WARNING_S = 1.5
"""How long a warning (press harder, too fast) stays."""
_WARNINGS = {"force_low", "force_high", "too_fast"}


@dataclass(frozen=True)
class Phase:
    """The stroke at this moment; `time_s` is the probe's, of the last change."""

    time_s: float
    contact: bool = False
    stroke: bool = False
    lump: bool = False
    force_low: bool = False
    force_high: bool = False
    too_fast: bool = False


class PhaseWatch:
    """Follows the changes; `now` is the phase."""

    def __init__(self) -> None:
        self.now = Phase(0.0)
        self._warned_s: float | None = None

    def change(self, event: StrokeState) -> None:
        """Take the next change."""
        time_s = event.time_us * 1e-6
        self.now = self._after(event.state, time_s)
        if event.state in _WARNINGS:
            self._warned_s = time_s

    def tick(self, time_s: float) -> None:
        """The probe's time goes on: a warning has been there long enough."""
        if self._warned_s is not None and not 0.0 <= time_s - self._warned_s <= WARNING_S:
            self._warned_s = None
            self.now = replace(self.now, time_s=time_s, force_low=False, force_high=False, too_fast=False)

    def reset(self) -> None:
        """The link broke: nothing is known of contact or stroke."""
        self.now = Phase(self.now.time_s)
        self._warned_s = None

    def _after(self, change: str, time_s: float) -> Phase:
        now = replace(self.now, time_s=time_s)
        if change in _WARNINGS:
            return replace(now, **{change: True})
        if change == "contact":
            return Phase(time_s, contact=True)
        if change == "started":
            return Phase(time_s, contact=True, stroke=True)
        if change == "lump_passed":
            return Phase(time_s, contact=True, stroke=True, lump=True)
        if change == "ended":
            return replace(now, stroke=False, lump=False)
        return Phase(time_s)
