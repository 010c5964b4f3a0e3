"""Strokes of a stream, fitted by the finite-element model beside it: `palpate stream --refine`."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager

from palpate.inversion.felt import NotInvertible
from palpate.inversion.recorded import Strokes
from palpate.inversion.result import Inverted
from palpate.inversion.strokes import invert_stroke
from palpate.sim.probe.noise import level_named
from palpate.sim.tissue.workers import pool
from palpate.wire.events import Event


class Refining:
    """One process that refines strokes in the order in which they came."""

    def __init__(self, executor: Executor) -> None:
        self._executor, self._strokes, self._noise = executor, Strokes(), level_named("typical")
        self._work: list[Future[Inverted]] = []

    def take(self, event: Event, calibration: bytes) -> None:
        """Watch an event go by."""
        if (found := self._strokes.take(event, calibration)) is None:
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
def refining() -> Iterator[Refining]:
    """Have a process beside this one; it ends with the block."""
    with pool(1, "palpate.inversion.strokes") as executor:
        yield Refining(executor)
