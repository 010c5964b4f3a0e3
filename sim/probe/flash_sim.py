"""A probe's store that loses its power: torn writes, and file systems that guarantee nothing until synced.

`FlashSim` has the methods of `firmware_py.store.FileStore`. It notes every operation; `cut_states`
replays such a trace up to every operation and every byte of every write and yields what a probe may
find when its power comes back.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from firmware_py import status

Files = dict[str, bytes]
Operation = tuple[str, str, bytes]  # create, append, remove or sync; name; data

# What a file system may make of the operations since the last sync:
KEPT = "kept"  # all of them, the last one torn
LOST = "lost"  # none of them
LAST_ONLY = "last only"  # the last one, torn, but none before it
HOLES = "holes"  # names and sizes of all of them, zeros for their content
IN_PLACE = "in place"  # all; a torn replacement leaves the end of the old content behind its own beginning
MODES = (KEPT, LOST, LAST_ONLY, HOLES, IN_PLACE)


class FlashSim:
    """A store in memory.

    Parameters
    ----------
    files : dict of str to bytes, optional
        What survived from before.
    full_at : int, optional
        Total bytes it holds; a write beyond that stores what fits and answers NO_SPACE.
    """

    def __init__(self, files: Files | None = None, full_at: int | None = None) -> None:
        self.files: Files = dict(files or {})
        self.trace: list[Operation] = []
        self.full_at = full_at

    def size(self, name: str) -> int:
        """Bytes of a name, -1 if there is none."""
        return len(self.files[name]) if name in self.files else -1

    def read(self, name: str, offset: int, n: int) -> bytes:
        """Up to n bytes from an offset."""
        return self.files.get(name, b"")[offset : offset + n]

    def create(self, name: str, data: bytes = b"") -> int:
        """Replace a name's content. A status."""
        return self._write("create", name, bytes(data))

    def append(self, name: str, data: bytes) -> int:
        """Add to a name's content. A status."""
        return self._write("append", name, bytes(data))

    def _write(self, what: str, name: str, data: bytes) -> int:
        room = len(data)
        if self.full_at is not None:
            others = sum(len(v) for k, v in self.files.items() if k != name or what == "append")
            room = max(0, min(room, self.full_at - others))
        operation = (what, name, data[:room])
        self.trace.append(operation)
        apply(self.files, operation)
        return status.OK if room == len(data) else status.NO_SPACE

    def remove(self, name: str) -> None:
        """Remove a name."""
        self.trace.append(("remove", name, b""))
        self.files.pop(name, None)

    def sync(self) -> None:
        """From here on everything before is safe."""
        self.trace.append(("sync", "", b""))


def apply(files: Files, operation: Operation, mode: str = KEPT) -> None:
    """Do one operation on `files`."""
    what, name, data = operation
    if mode == HOLES:
        data = bytes(len(data))
    if what == "create":
        old = files.get(name, b"") if mode == IN_PLACE else b""
        files[name] = data + old[len(data) :]
    elif what == "append":
        files[name] = files.get(name, b"") + data
    elif what == "remove":
        files.pop(name, None)


def cut_states(files: Files, trace: Sequence[Operation]) -> Iterator[tuple[int, str, Files]]:
    """Every state that a cut may leave of a trace which started from `files` (synced).

    Yields
    ------
    operation : int
        Which operation was torn.
    mode : str
        What became of those not yet synced (`MODES`).
    files : dict
    """
    safe = dict(files)  # after the last sync
    whole = dict(files)  # with everything since then
    holes = dict(files)  # with its names and sizes
    for number, operation in enumerate(trace):
        what, name, data = operation
        if what == "sync":
            yield number, LOST, dict(safe)
            yield number, KEPT, dict(whole)
            yield number, HOLES, dict(holes)
            safe, holes = dict(whole), dict(whole)
            continue
        for byte in range(len(data) + 1):
            torn = (what, name, data[:byte])
            for mode, before in ((KEPT, whole), (IN_PLACE, whole), (HOLES, holes), (LAST_ONLY, safe)):
                left = dict(before)
                apply(left, torn, mode)
                yield number, mode, left
            yield number, LOST, dict(safe)
        apply(whole, operation)
        apply(holes, operation, HOLES)
    yield len(trace), LOST, dict(safe)
    yield len(trace), KEPT, dict(whole)
    yield len(trace), HOLES, dict(holes)
