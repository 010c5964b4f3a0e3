"""Preloaded before all else where workers are forked: one that starts as its program ends says nothing of it.

The program has taken its semaphores and pipes away by then, which the worker would tell with a traceback.
"""

from __future__ import annotations

import multiprocessing
import sys
from pathlib import Path
from types import TracebackType

_GONE = (FileNotFoundError, EOFError, ConnectionError)


def _unless_the_program_has_gone(
    kind: type[BaseException], error: BaseException, at: TracebackType | None
) -> None:
    """As `sys.excepthook`; what fails in multiprocessing itself for want of the other end is passed over."""
    last = at
    while last is not None and last.tb_next is not None:
        last = last.tb_next
    inside = (
        last is not None and Path(last.tb_frame.f_code.co_filename).parent.name == multiprocessing.__name__
    )
    if not (inside and issubclass(kind, _GONE)):
        sys.__excepthook__(kind, error, at)


sys.excepthook = _unless_the_program_has_gone
