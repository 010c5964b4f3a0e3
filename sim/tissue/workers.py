"""A pool of processes that leaves none behind, and whose linear algebra takes one thread in each."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, InvalidStateError, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from typing import Any


class QuietPool(ProcessPoolExecutor):
    """A pool whose processes know nothing of Ctrl-C: the program that uses them hears it, and ends them.

    A terminal sends it to all of them; each that was at its imports or waiting complained with a traceback.
    """

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """As the executor's; the first call starts the processes, which inherit what is blocked here."""
        with _interrupt_held():
            return super().submit(fn, *args, **kwargs)


@contextmanager
def _interrupt_held() -> Iterator[None]:
    """Ctrl-C waits until the block has ended, and is blocked in processes that start within it.

    The mask is for them: another thread of ours would still take the signal, and a process that is not yet
    known as ours would go on without us.
    """
    if not hasattr(signal, "pthread_sigmask") or threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[Any] = []
    handler = signal.signal(signal.SIGINT, lambda *said: came.append(said))
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        signal.signal(signal.SIGINT, signal.SIG_DFL if handler is None else handler)
        if came and callable(handler):
            handler(*came[0])


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
        context.set_forkserver_preload(["palpate.sim.tissue.worker_start", preload])
    with _one_thread_each():
        yield from _pool(workers, context)


def _pool(workers: int, context: Any) -> Iterator[Executor]:
    others = set(multiprocessing.active_children())
    pool = QuietPool(workers, mp_context=context, initializer=_die_with_parent)
    try:
        yield pool
    except BaseException:
        with _cancelled_in_silence():
            for worker in set(multiprocessing.active_children()) - others:
                worker.terminate()  # what it is at would keep us for minutes; files are whole or not there
                worker.join()
            with suppress(RuntimeError):  # its thread never ran
                pool.shutdown(cancel_futures=True)
        raise
    pool.shutdown()


@contextmanager
def _cancelled_in_silence() -> Iterator[None]:
    """The pool's thread may find work cancelled that it wants to call failed, and would print a traceback."""
    hook = threading.excepthook

    def unless_cancelled(error: threading.ExceptHookArgs) -> None:
        if not issubclass(error.exc_type, InvalidStateError):
            hook(error)

    threading.excepthook = unless_cancelled
    try:
        yield
    finally:
        threading.excepthook = hook


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
