"""Waiting for a condition and never for a time, however busy the machine is."""

from __future__ import annotations

import time
from collections.abc import Callable

PATIENCE_S = 120.0
"""For whatever must come in the end, on a machine of any speed; what comes in order never waits so long."""


def wait_until(
    holds: Callable[[], bool], what: str | Callable[[], object] = "", patience_s: float = PATIENCE_S
) -> None:
    """Wait until `holds` is true; `what` was awaited, or how it stands, is said if it never is."""
    deadline = time.monotonic() + patience_s
    while not holds():
        assert time.monotonic() < deadline, f"never came: {what() if callable(what) else what}"
        time.sleep(0.02)
