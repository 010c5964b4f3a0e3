"""Linear algebra on one thread: more make small matrices slow, and wait for each other where processes share
the machine."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import cache, wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

_P = ParamSpec("_P")
_R = TypeVar("_R")


def one_blas_thread() -> AbstractContextManager[object]:
    """While this lasts, linear algebra keeps to one thread; more would slow small matrices tenfold."""
    return _blas().limit(limits=1, user_api="blas")


def on_one_blas_thread(work: Callable[_P, _R]) -> Callable[_P, _R]:
    """A function that does this work under `one_blas_thread`."""

    @wraps(work)
    def on_one(*args: _P.args, **named: _P.kwargs) -> _R:
        with one_blas_thread():
            return work(*args, **named)

    return on_one


@cache
def _blas() -> ThreadpoolController:
    import scipy.linalg  # noqa: F401 (its own BLAS must be loaded to be found)

    return ThreadpoolController()
