"""A pool of processes that leaves none behind, and whose linear algebra takes one thread in each."""

from __future__ import annotations

import multiprocessing
import os
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any


@contextmanager
def pool(workers: int, preload: str) -> Iterator[Executor]:
    """So many processes; an interrupt ends them cleanly, even one that comes while they start.

    Parameters
    ----------
    workers : int
        How many.
    preload : str
        The module that they need, imported once for all where processes can be forked.
    """
    method = "forkserver" if sys.platform == "linux" else "spawn"
    context = multiprocessing.get_context(method)
    if method == "forkserver":
        context.set_forkserver_preload([preload])
    with _one_thread_each():
        yield from _pool(workers, context)


def _pool(workers: int, context: Any) -> Iterator[Executor]:
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_die_with_parent)
    try:
        yield pool
    except BaseException:
        try:
            pool.shutdown(cancel_futures=True)
        except RuntimeError:  # its thread never ran, so nobody but us ends the workers
            for worker in set(multiprocessing.active_children()) - others:
                worker.terminate()
                worker.join()
        raise
    pool.shutdown()


def _die_with_parent() -> None:
    """End this worker when the program that uses it is killed: a pool's workers would wait forever."""

    def watch() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Processes started meanwhile use one thread each in their linear algebra."""
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
