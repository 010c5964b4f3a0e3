"""Strokes of a stream, and presses of somebody's array, fitted by the finite-element model beside it."""

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


class Refining:
    """One process that refines strokes in the order in which they came."""

    def __init__(self, executor: Executor, port: str) -> None:
        self._executor, self._strokes, self._noise = executor, FeltStrokes(port), level_named("typical")
        self._presses_too = address_of(port) is not None
        self._work: list[Future[Inverted]] = []

    def take(self, event: Event, calibration: bytes) -> None:
        """Watch an event go by."""
        found = self._strokes.take(event, calibration)
        if found is None or (self._strokes.was_press and not self._presses_too):
            return
        stroke, start = found
        if isinstance(stroke, NotInvertible):
            self._work.append(Future())
            self._work[-1].set_result(Inverted(start.stroke, problem=str(stroke)))
        else:
            self._work.append(self._executor.submit(invert_stroke, stroke, start, self._noise))

    def done(self) -> Iterator[Inverted]:
        """Those that are ready and were not given yet."""
        while self._work and self._work[0].done():
            yield self._work.pop(0).result()

    @property
    def waiting(self) -> int:
        """How many are not ready."""
        return len(self._work)

    def rest(self) -> Iterator[Inverted]:
        """All others, as they become ready."""
        while self._work:
            yield self._work.pop(0).result()


@contextmanager
def refining(port: str) -> Iterator[Refining]:
    """Have a process beside this one; it ends with the block."""
    with pool(1, "palpate.inversion.strokes") as executor:
        yield Refining(executor, port)
