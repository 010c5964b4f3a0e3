"""Many strokes: one code path over any `concurrent.futures.Executor`, results kept as they come."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)
from dataclasses import replace
from pathlib import Path

import pandas as pd

from palpate.sim.tissue.case import Case
from palpate.sim.tissue.errors import CaseError, SweepStopped, TissueError
from palpate.sim.tissue.records import Record, record_of
from palpate.sim.tissue.settings import Settings, case_key
from palpate.sim.tissue.store import StrokeStore
from palpate.sim.tissue.sweep_progress import Progress, Reporter
from palpate.sim.tissue.tables import read_table
from palpate.sim.tissue.workers import pool

_GROUP = 4
"""Most cases in one task: neighbours that share their geometry share its set-up."""

_SYNC_S = 2.0

_CLUSTERS = ("distributed", "dask", "asyncio")
"""Whose own errors mean that the cluster has gone."""


def sweep(
    cases: Sequence[Case],
    settings: Settings | None = None,
    out_dir: str | Path = "sweep",
    executor: Executor | None = None,
    workers: int | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> pd.DataFrame:
    """Simulate all cases that `out_dir` does not hold yet.

    Parameters
    ----------
    cases : sequence of Case
        The design; its order is the table's.
    settings : Settings, optional
        The same for all.
    out_dir : path
        Where the strokes are kept (`store.py`); interrupt at will, a second call goes on.
    executor : Executor, optional
        Where to compute, for example `distributed.Client(address).get_executor()`; by default a pool of
        processes.
    workers : int, optional
        Size of that pool; all cores by default.
    progress : callable, optional
        Called with a `Progress` now and then.

    Returns
    -------
    DataFrame
        One row per case: key, code, status (`ok` or `failed`), reason, inputs and size of the work; the
        series (`read_table`, `load_strokes`, `iterate_strokes`) stay on disk, since those of a large sweep
        would not fit into memory.

    Raises
    ------
    CaseError
        There is nothing to do, `out_dir` cannot be written, or another sweep is writing into it.
    SweepStopped
        The cluster or a worker has gone; what was finished is kept.
    """
    settings = settings or Settings()
    if not cases:
        raise CaseError("the design holds no cases")
    keys = [case_key(case, settings) for case in cases]
    try:
        store = StrokeStore(Path(out_dir))
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise CaseError(f"cannot keep strokes in {out_dir}: {why}") from None
    todo = {key: case for key, case in zip(keys, cases) if key not in store}
    reporter = Reporter(len(set(keys)), len(set(keys)) - len(todo), progress)
    try:
        if todo:
            if executor is not None:
                _run(_groups(todo), settings, executor, 64, store, reporter)
            else:
                _run_in_pool(todo, settings, workers, store, reporter)
        reporter.show()
    except BaseException:
        store.sync()
        store.close()
        raise
    store.seal(list(dict.fromkeys(keys)), any(case.solid for case in cases))
    return read_table(out_dir, series=False)


def compute_group(cases: Sequence[tuple[str, Case]], settings: Settings) -> list[Record]:
    """What a worker does: simulate a few cases; a failure becomes a record, not an end."""
    from palpate.sim.tissue.stroke import simulate

    if len(cases) and cases[0][1].solid:
        return _compute_solid(cases, settings)
    records = []
    for key, case in cases:
        try:
            records.append(record_of(key, case, simulate(case, settings)))
        except TissueError as error:
            records.append(record_of(key, case, error))
    return records


def _compute_solid(cases: Sequence[tuple[str, Case]], settings: Settings) -> list[Record]:
    """Strokes over one solid lump, which differ in force only, together and with a press-in ramp."""
    from palpate.sim.tissue.solid.stroke import simulate_forces

    try:
        strokes = simulate_forces(cases[0][1], [case.F_rel for _, case in cases], settings, ramp=True)
        return [record_of(key, case, stroke) for (key, case), stroke in zip(cases, strokes)]
    except TissueError as error:
        if len(cases) == 1:
            return [record_of(cases[0][0], cases[0][1], error)]
        return [record for one in cases for record in _compute_solid([one], settings)]


def _same_task(case: Case, other: Case) -> bool:
    """Whether two cases share so much that one task had better do both."""
    if case.solid or other.solid:
        return replace(case, F_rel=other.F_rel) == other
    one, two = ((c.d_mm, c.h, c.borders_mm, c.fat_mm) for c in (case, other))
    return one == two


def _groups(todo: dict[str, Case]) -> Iterator[list[tuple[str, Case]]]:
    group: list[tuple[str, Case]] = []
    for key, case in todo.items():
        if group and (not _same_task(case, group[0][1]) or len(group) == _GROUP):
            yield group
            group = []
        group.append((key, case))
    if group:
        yield group


def _run(
    groups: Iterable[list[tuple[str, Case]]],
    settings: Settings,
    executor: Executor,
    outstanding: int,
    store: StrokeStore,
    reporter: Reporter,
) -> None:
    """Keep `outstanding` tasks with the executor until all groups are done."""
    source, pending = iter(groups), set[Future]()
    synced = time.monotonic()
    try:
        while True:
            while len(pending) < outstanding and (group := next(source, None)) is not None:
                pending.add(executor.submit(compute_group, group, settings))
            if not pending:
                return
            done, pending = wait(pending, return_when=FIRST_COMPLETED)
            _keep(done, store, reporter)
            if time.monotonic() - synced > _SYNC_S:
                store.sync()
                synced = time.monotonic()
    except BaseException:
        for future in pending:
            future.cancel()
        raise


def _keep(done: Iterable[Future], store: StrokeStore, reporter: Reporter) -> None:
    """Store what tasks have computed; only then raise what one of them failed with."""
    failure: BaseException | None = None
    for future in done:
        try:
            for record in _result(future):
                store.add(record)
                reporter.count(record["status"] == "failed")
        except (TissueError, CancelledError) as error:
            failure = failure or error
    if failure is not None:
        raise failure


def _result(future: Future) -> list[Record]:
    """A task's strokes; `SweepStopped` where its worker or its cluster has gone."""
    try:
        records: list[Record] = future.result()
    except (CancelledError, BrokenExecutor, OSError) as error:
        raise SweepStopped(type(error).__name__) from error
    except Exception as error:
        if type(error).__module__.partition(".")[0] not in _CLUSTERS:
            raise
        raise SweepStopped(type(error).__name__) from error
    return records


def _run_in_pool(
    todo: dict[str, Case], settings: Settings, workers: int | None, store: StrokeStore, reporter: Reporter
) -> None:
    workers = min(workers or os.cpu_count() or 1, len(todo))
    with pool(workers, preload="palpate.sim.tissue.stroke") as executor:
        _run(_groups(todo), settings, executor, 4 * workers, store, reporter)
