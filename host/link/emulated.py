"""Where emulated probes leave a note of their port, so that `auto` finds them as it finds USB."""

from __future__ import annotations

import json
import os
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path


@dataclass(frozen=True)
class Note:
    """One emulated probe that is up.

    Parameters
    ----------
    port : str
        What `--port` takes: a pseudo-terminal's path or `socket://HOST:PORT`.
    pid : int
        The process that emulates it.
    code : str
        The case under its sensors.
    runtime : str
        What carries its firmware.
    """

    port: str
    pid: int
    code: str
    runtime: str


def directory() -> Path:
    """The user's run-time directory: XDG_RUNTIME_DIR/palpate, or a private one in the temporary directory."""
    base = os.environ.get("XDG_RUNTIME_DIR")
    if base:
        return Path(base) / "palpate"
    owner = os.getuid() if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")
    return Path(tempfile.gettempdir()) / f"palpate-{owner}"


def leave(note: Note) -> Path:
    """Write a note; the caller removes the file when its probe ends."""
    folder = directory()
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    path = folder / f"{note.pid}-{abs(hash(note.port)) % 10**8}.json"
    temporary = path.with_suffix(".part")
    temporary.write_text(json.dumps(asdict(note)))
    temporary.replace(path)
    return path


def running() -> list[Note]:
    """The notes of processes that live; those of dead ones (killed, not ended) are removed."""
    found = []
    for path in sorted(directory().glob("*.json")):
        try:
            note = Note(**json.loads(path.read_text()))
        except (OSError, ValueError, TypeError):
            continue
        if _alive(note.pid):
            found.append(note)
        else:
            path.unlink(missing_ok=True)
    return found


def _alive(pid: int) -> bool:
    if os.name == "nt":
        return True  # a stale note is found out by the handshake
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
