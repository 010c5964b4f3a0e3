"""Many strokes observed through the sensors, on all cores, with the same result whatever their number."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import Any

from palpate.learn.observed import Observed, joined, observe
from palpate.progress import ProgressCallback
from palpate.sim.probe.sensors import Noise, StrokeField
from palpate.sim.tissue.workers import QuietPool

AT_A_TIME = 48
WORTH_A_POOL = 600


class Observer:
    """Observes strokes, in processes of its own if there are many; use as a context manager.

    Parameters
    ----------
    workers : int, optional
        Processes; by default one for each core, 1 for none.
    progress : callable, optional
        See `progress.ProgressCallback`.
    worth_a_pool : int
        Strokes; fewer are observed in less time than processes take to start.
    """

    def __init__(
        self,
        workers: int | None = None,
        progress: ProgressCallback | None = None,
        worth_a_pool: int = WORTH_A_POOL,
    ) -> None:
        self.workers = workers or os.cpu_count() or 1
        self.progress = progress
        self.worth_a_pool = worth_a_pool
        self._pool: QuietPool | None = None

    def __enter__(self) -> Observer:
        return self

    def __exit__(self, *_: object) -> None:
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
            self._pool = None

    def observe(
        self,
        fields: Sequence[StrokeField],
        noise: Noise,
        seeds: Sequence[int],
        groups: Sequence[int],
        mean_forces_N_per_m: Sequence[float] | None = None,
        **options: Any,
    ) -> Observed:
        """Every field once for each seed, as `observed.observe` does; `options` are further options of it."""
        pieces = []
        for seed in seeds:
            for at in range(0, len(fields), AT_A_TIME):
                part = slice(at, at + AT_A_TIME)
                means = None if mean_forces_N_per_m is None else mean_forces_N_per_m[part]
                more = {"mean_forces_N_per_m": means, "first": at, **options}
                pieces.append(((fields[part], noise, seed, groups[part]), more))
        total = len(seeds) * len(fields)
        if self.workers < 2 or total < self.worth_a_pool:
            observed = []
            for arguments, more in pieces:
                observed.append(observe(*arguments, **more))
                self._tell(sum(map(len, observed)), total)
            return joined(observed)
        if self._pool is None:
            spawn = multiprocessing.get_context("spawn")
            self._pool = QuietPool(self.workers, mp_context=spawn)
        jobs = [self._pool.submit(observe, *arguments, **more) for arguments, more in pieces]
        pending: set[Future[Observed]] = set(jobs)
        while pending:
            _, pending = wait(pending, return_when=FIRST_COMPLETED)
            self._tell(sum(len(job.result()) for job in jobs if job.done()), total)
        return joined([job.result() for job in jobs])

    def _tell(self, done: int, total: int) -> None:
        if self.progress is not None:
            self.progress("strokes observed through the sensors", done, total)
