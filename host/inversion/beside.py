"""Strokes of a session as it goes by, and presses of somebody's array, fitted by one process beside it."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager

from palpate.inversion.felt import NotInvertible
from palpate.inversion.recorded import FeltStrokes
from palpate.inversion.result import Inverted
from palpate.inversion.strokes import invert_stroke
from palpate.link.schemes import address_of
from palpate.sim.probe.noise import level_named
from palpate.sim.tissue.workers import pool
from palpate.wire.events import Event

Fitting = Future[Inverted]


class Beside:
    """Watches a session's events; what it finds is fitted in the order in which it came.

    Parameters
    ----------
    executor : Executor
        Where it is fitted.
    port : str
        Where the session comes from, as `FeltStrokes` takes it.
    """

    def __init__(self, executor: Executor, port: str) -> None:
        self._executor, self._strokes, self._noise = executor, FeltStrokes(port), level_named("typical")
        self._presses_too = address_of(port) is not None

    def take(self, event: Event, calibration: bytes) -> Fitting | None:
        """Watch an event go by; of the stroke that ends with it, its fit to come."""
        found = self._strokes.take(event, calibration)
        if found is None or (self._strokes.was_press and not self._presses_too):
            return None
        stroke, start = found
        if not isinstance(stroke, NotInvertible):
            return self._executor.submit(invert_stroke, stroke, start, self._noise)
        known: Fitting = Future()
        known.set_result(Inverted(start.stroke, problem=str(stroke), press=self._strokes.was_press))
        return known


@contextmanager
def one_process() -> Iterator[Executor]:
    """A process for it; what it is at when the block ends is finished first, unless an exception ends it."""
    with pool(1, "palpate.inversion.strokes") as executor:
        yield executor
