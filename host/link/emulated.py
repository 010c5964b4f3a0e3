"""Where emulated probes register their ports, so that `auto` finds them as it finds USB."""

from __future__ import annotations

import json
import os
import stat
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

from palpate.errors import PalpateError

MOST_SLOW = 1000.0


@dataclass(frozen=True)
class Note:
    """One emulated probe that is running.

    Parameters
    ----------
    port : str
        What `--port` takes: a pseudo-terminal's path or `socket://HOST:PORT`.
    pid : int
        The process that emulates it.
    code : str
        The case under its sensors.
    runtime : str
        What runs its firmware.
    times_slower : float
        How many of this computer's seconds one of the probe's takes: an emulated board has none of its own.
    """

    port: str
    pid: int
    code: str
    runtime: str
    times_slower: float = 1.0


def directory() -> Path:
    """The user's run-time directory: XDG_RUNTIME_DIR/palpate, or a private one in the temporary directory."""
    base = os.environ.get("XDG_RUNTIME_DIR")
    if base:
        return Path(base) / "palpate"
    owner = os.getuid() if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")
    return Path(tempfile.gettempdir()) / f"palpate-{owner}"


def is_ours(folder: Path) -> bool:
    """Is it a directory that nobody but this user can have put anything into?

    In the shared temporary directory anybody may have made one of that name, or a link.
    """
    try:
        found = folder.lstat()
    except OSError:
        return False
    if not stat.S_ISDIR(found.st_mode):
        return False
    return not hasattr(os, "getuid") or (found.st_uid == os.getuid() and not found.st_mode & 0o022)


def leave(note: Note) -> Path:
    """Write a note; the caller removes the file when its probe ends.

    Raises
    ------
    PalpateError
        The directory for it is not this user's own.
    """
    folder = directory()
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if not is_ours(folder):
        raise PalpateError(
            f"{folder} belongs to another user or can be written by one; set XDG_RUNTIME_DIR to a directory "
            "of your own"
        )
    path = folder / f"{note.pid}-{abs(hash(note.port)) % 10**8}.json"
    temporary = path.with_suffix(".part")
    temporary.write_text(json.dumps(asdict(note)))
    temporary.replace(path)
    return path


def running() -> list[Note]:
    """The notes of running processes; those of killed ones are removed."""
    found: list[Note] = []
    folder = directory()
    if not is_ours(folder):
        return found
    for path in sorted(folder.glob("*.json")):
        try:
            note = Note(**json.loads(path.read_text()))
        except (OSError, ValueError, TypeError, RecursionError):
            continue
        words = (note.port, note.code, note.runtime)
        if type(note.pid) is not int or not all(isinstance(w, str) and w.isprintable() for w in words):
            continue
        if type(note.times_slower) not in (int, float) or not 1 <= note.times_slower <= MOST_SLOW:
            continue
        if _alive(note.pid):
            found.append(note)
        else:
            path.unlink(missing_ok=True)
    return found


def times_slower(port: str) -> float:
    """How many of this computer's seconds one second of the probe at a port takes; 1 for every real one."""
    return next((note.times_slower for note in running() if note.port == port), 1.0)


def _alive(pid: int) -> bool:
    if os.name == "nt":
        return True  # the handshake finds a stale note out
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
