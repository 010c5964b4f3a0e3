"""Many strokes seen through the sensors, on all cores, with the same result whatever their number."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from typing import Any

from host.regression.seen import Seen, join, look
from host.regression.watch import Watch
from sim.probe.sensors import Noise, StrokeField

AT_A_TIME = 48
WORTH_A_POOL = 600


class Sight:
    """Looks at strokes, in processes of its own if there are many; use as a context manager.

    Parameters
    ----------
    workers : int, optional
        Processes; by default one for each core, 1 for none.
    watch : callable, optional
        See `watch.Watch`.
    worth_a_pool : int
        Strokes; fewer are seen sooner than processes start.
    """

    def __init__(
        self, workers: int | None = None, watch: Watch | None = None, worth_a_pool: int = WORTH_A_POOL
    ) -> None:
        self.workers = workers or os.cpu_count() or 1
        self.watch = watch
        self.worth_a_pool = worth_a_pool
        self._pool: ProcessPoolExecutor | None = None

    def __enter__(self) -> Sight:
        return self

    def __exit__(self, *_: object) -> None:
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
            self._pool = None

    def look(
        self,
        fields: Sequence[StrokeField],
        noise: Noise,
        seeds: Sequence[int],
        groups: Sequence[int],
        mean_forces_N_per_m: Sequence[float] | None = None,
        **words: Any,
    ) -> Seen:
        """Every field once for each seed, as `seen.look` sees it; `words` are further words of it."""
        pieces = []
        for seed in seeds:
            for at in range(0, len(fields), AT_A_TIME):
                part = slice(at, at + AT_A_TIME)
                means = None if mean_forces_N_per_m is None else mean_forces_N_per_m[part]
                more = {"mean_forces_N_per_m": means, "first": at, **words}
                pieces.append(((fields[part], noise, seed, groups[part]), more))
        total = len(seeds) * len(fields)
        if self.workers < 2 or total < self.worth_a_pool:
            seen = []
            for arguments, more in pieces:
                seen.append(look(*arguments, **more))
                self._tell(sum(map(len, seen)), total)
            return join(seen)
        if self._pool is None:
            spawn = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(self.workers, mp_context=spawn)
        jobs = [self._pool.submit(look, *arguments, **more) for arguments, more in pieces]
        pending: set[Future[Seen]] = set(jobs)
        while pending:
            _, pending = wait(pending, return_when=FIRST_COMPLETED)
            self._tell(sum(len(job.result()) for job in jobs if job.done()), total)
        return join([job.result() for job in jobs])

    def _tell(self, done: int, total: int) -> None:
        if self.watch is not None:
            self.watch("strokes seen through the sensors", done, total)
