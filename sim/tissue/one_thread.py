"""Linear algebra on one thread: more make small matrices slow, and wait for each other where processes share
the machine."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

from threadpoolctl import ThreadpoolController


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """While this lasts, linear algebra keeps to one thread; more would slow small matrices tenfold."""
    with _blas().limit(limits=1, user_api="blas"):
        yield


@cache
def _blas() -> ThreadpoolController:
    import scipy.linalg  # noqa: F401 (its own BLAS must be loaded to be found)

    return ThreadpoolController()
