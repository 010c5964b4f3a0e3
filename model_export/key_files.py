"""Files that survive a power cut, a lock that dies with its holder, and the witness of a signing key.

The witness is a record outside the key's directory, so that a directory which was copied back from a
backup can be told from the one that signed last.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from model_export.errors import SigningError


def witness_directory() -> Path:
    """Where the third record lives: $PALPATE_STATE, or palpate/ in the user's state directory."""
    own = os.environ.get("PALPATE_STATE")
    if own:
        return Path(own)
    base = os.environ.get("XDG_STATE_HOME") or os.environ.get("LOCALAPPDATA")
    return Path(base or Path.home() / ".local" / "state") / "palpate"


def write(path: Path, data: bytes, mode: int = 0o644) -> None:
    """Replace a file so that a cut leaves the old or the new one, and return once it is on disk."""
    temporary = path.with_name(path.name + ".new")
    handle = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, mode)
    with os.fdopen(handle, "wb") as out:
        out.write(data)
        out.flush()
        os.fsync(out.fileno())
    os.replace(temporary, path)
    sync_directory(path.parent)


def append(path: Path, line: str) -> None:
    with path.open("a", encoding="ascii") as out:
        out.write(line + "\n")
        out.flush()
        os.fsync(out.fileno())
    sync_directory(path.parent)


def sync_directory(path: Path) -> None:
    if os.name == "nt":
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@contextlib.contextmanager
def locked(directory: Path) -> Iterator[None]:
    """Only one program signs with a key at a time; the lock goes with the process that holds it."""
    lock = (directory / "lock").open("a+")
    try:
        try:
            if os.name == "nt":
                import msvcrt

                msvcrt.locking(lock.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
            else:
                import fcntl

                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise SigningError(
                f"another program is signing with the key in {directory}; wait for it"
            ) from None
        yield
    finally:
        lock.close()


def state(following: int, word: str) -> bytes:
    """A state as it is written: the next unused leaf, and the word of the last signature."""
    return json.dumps({"next": following, "word": word}).encode() + b"\n"


def read_state(path: Path) -> tuple[int, str]:
    """A written state; ValueError, KeyError, TypeError or OSError if it is none."""
    data: Any = json.loads(path.read_text())
    following, word = data["next"], data["word"]
    if type(following) is not int or following < 0 or not isinstance(word, str):
        raise ValueError
    return following, word


def witness_file(ident: bytes) -> Path:
    """The witness of the key with this identifier."""
    return witness_directory() / f"{ident.hex()}.json"


def write_witness(ident: bytes, following: int, word: str) -> None:
    """Note outside the key's directory how far it has signed."""
    witness_directory().mkdir(parents=True, exist_ok=True)
    write(witness_file(ident), state(following, word))
