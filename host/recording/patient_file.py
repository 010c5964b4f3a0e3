"""A file for libraries that do not survive a full disk: they go on writing, and the error is told between."""

from __future__ import annotations

import io
from pathlib import Path


class PatientFile(io.FileIO):
    """A file whose `write` never fails; the first error is kept, and raised by `check`.

    HDF5 crashes the interpreter when it cannot write what it still holds while it closes a file.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, "w+")
        self._failure: OSError | None = None

    def write(self, data) -> int:  # type: ignore[no-untyped-def, override]
        """Write all of it, or keep why not."""
        view = memoryview(data).cast("B")
        size = len(view)
        try:
            while view and self._failure is None:
                view = view[super().write(view) or 0 :]
        except OSError as error:
            self._failure = error
        return size

    def flush(self) -> None:
        """Nothing is held back."""

    def truncate(self, size: int | None = None) -> int:
        """Set the length, or keep why not."""
        try:
            return super().truncate(size)
        except OSError as error:
            self._failure = self._failure or error
            return size or 0

    def check(self) -> None:
        """Raise the error that a write has met, if any."""
        if self._failure is not None:
            raise self._failure
