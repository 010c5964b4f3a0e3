"""The general compiler's errors as the exporter's."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from palpate.fixedpoint.errors import CompileError
from palpate.model_export.errors import ProofError


@contextmanager
def told_as_ours() -> Iterator[None]:
    """The general compiler's errors as ProofError; also a decorator."""
    try:
        yield
    except CompileError as error:
        raise ProofError(str(error)) from None
