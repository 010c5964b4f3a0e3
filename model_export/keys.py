"""Signing keys on disk. An LMS key signs once with each leaf, so its state outlives everything here.

A key directory holds

    secret.json    seed, identifier, parameters (mode 600)
    tree.bin       the tree's leaves (public; saves growing them again)
    public.key     56 bytes for the probe
    state.json     the next unused leaf, and a random word that changes with every signature
    journal        one line for every leaf used: number, random word, hash of what it signed

Before a signature leaves, the journal and then the state are on disk (fsync of file and directory).
A directory that was copied back from a backup holds a state, or a journal, older than a leaf already
used; the two are checked against each other, and against a third record outside the directory, in
the user's own state directory. Using a leaf twice would let anyone forge signatures, so when in doubt
the key is refused and a new one must be made.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import secrets
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from firmware_py import lms, status
from model_export import lms_sign
from model_export.errors import SigningError


def witness_directory() -> Path:
    """Where the third record lives: $PALPATE_STATE, or palpate/ in the user's state directory."""
    own = os.environ.get("PALPATE_STATE")
    if own:
        return Path(own)
    base = os.environ.get("XDG_STATE_HOME") or os.environ.get("LOCALAPPDATA")
    return Path(base or Path.home() / ".local" / "state") / "palpate"


def _write(path: Path, data: bytes, mode: int = 0o644) -> None:
    """Replace a file so that a cut leaves the old or the new one, and return once it is on disk."""
    temporary = path.with_name(path.name + ".new")
    handle = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, mode)
    with os.fdopen(handle, "wb") as out:
        out.write(data)
        out.flush()
        os.fsync(out.fileno())
    os.replace(temporary, path)
    _sync_directory(path.parent)


def _append(path: Path, line: str) -> None:
    with path.open("a", encoding="ascii") as out:
        out.write(line + "\n")
        out.flush()
        os.fsync(out.fileno())
    _sync_directory(path.parent)


def _sync_directory(path: Path) -> None:
    if os.name == "nt":
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@contextlib.contextmanager
def _locked(directory: Path) -> Iterator[None]:
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


def generate(
    directory: str | os.PathLike[str],
    height: int = 10,
    width: int = 8,
    progress: Callable[[int, int], None] | None = None,
    secret: lms_sign.Secret | None = None,
) -> bytes:
    """Make a signing key in a new directory (`palpate keygen`); returns the public key.

    Parameters
    ----------
    directory : path
        Must not hold a key yet.
    height : int
        5, 10 or 15: the key signs 32, 1024 or 32768 images.
    width : int
        4 or 8 bits a digit: signatures of 2508 or 1452 bytes (height 10); 8 takes longer to make and to verify.
    progress : callable, optional
        Called with the leaves done and all leaves.
    secret : Secret, optional
        For tests; otherwise drawn from the operating system.

    Raises
    ------
    SigningError
        If the directory cannot be written or already holds a key.
    """
    if height not in lms_sign.HEIGHTS or width not in lms_sign.WIDTHS:
        raise SigningError("a key has a height of 5, 10 or 15 and a width of 1, 2, 4 or 8")
    path = Path(directory)
    try:
        path.mkdir(parents=True, exist_ok=True)
        if (path / "secret.json").exists():
            raise SigningError(f"{path} already holds a signing key; choose another directory")
        if secret is None:
            secret = lms_sign.Secret(secrets.token_bytes(32), secrets.token_bytes(16), height, width)
        leaves = []
        for number in range(1 << secret.height):
            leaves.append(lms_sign.leaf_node(secret, number))
            if progress is not None:
                progress(number + 1, 1 << secret.height)
        public = lms_sign.public_key(secret, lms_sign.tree(secret, leaves))
        content = {
            "format": "palpate-signing-key",
            "version": 1,
            "seed": secret.seed.hex(),
            "ident": secret.ident.hex(),
            "height": secret.height,
            "width": secret.width,
        }
        word = secrets.token_hex(16)
        _write(path / "tree.bin", b"".join(leaves))
        _write(path / "public.key", public)
        _write(path / "journal", b"")
        _write(path / "state.json", _state(0, word))
        _witness(secret.ident, 0, word)
        # last, so that a directory without it is no key
        _write(path / "secret.json", json.dumps(content, indent=1).encode() + b"\n", 0o600)
    except OSError as error:
        raise SigningError(f"the key cannot be written to {path}: {error.strerror or error}") from None
    return public


def _state(following: int, word: str) -> bytes:
    return json.dumps({"next": following, "word": word}).encode() + b"\n"


def _witness(ident: bytes, following: int, word: str) -> None:
    directory = witness_directory()
    directory.mkdir(parents=True, exist_ok=True)
    _write(directory / f"{ident.hex()}.json", _state(following, word))


@dataclass(frozen=True)
class Key:
    """A key directory, read. `used` leaves of `count` are gone."""

    directory: Path
    secret: lms_sign.Secret
    public: bytes
    used: int

    @property
    def count(self) -> int:
        """How many images the key can sign in all."""
        return 1 << self.secret.height


def load(directory: str | os.PathLike[str]) -> Key:
    """Read a key directory; SigningError if it is missing, damaged or copied back."""
    path = Path(directory)
    try:
        data = json.loads((path / "secret.json").read_text())
        if data["format"] != "palpate-signing-key" or data["version"] != 1:
            raise ValueError
        secret = lms_sign.Secret(
            bytes.fromhex(data["seed"]), bytes.fromhex(data["ident"]), data["height"], data["width"]
        )
        public = (path / "public.key").read_bytes()
        if len(secret.seed) != 32 or public[:24] != secret.types + secret.ident or len(public) != 56:
            raise ValueError
    except FileNotFoundError:
        raise SigningError(f"{path} holds no signing key; make one with `palpate keygen {path}`") from None
    except (OSError, ValueError, KeyError, TypeError, AssertionError):
        raise SigningError(
            f"the signing key in {path} is damaged; make a new one with `palpate keygen`"
        ) from None
    return Key(path, secret, public, _used(path, secret))


def _read_state(path: Path) -> tuple[int, str]:
    data: Any = json.loads(path.read_text())
    following, word = data["next"], data["word"]
    if type(following) is not int or following < 0 or not isinstance(word, str):
        raise ValueError
    return following, word


def _used(path: Path, secret: lms_sign.Secret) -> int:
    """Leaves used; refuses a directory whose records do not agree with each other and with the witness."""
    stale = SigningError(
        f"the key in {path} was copied back: a newer state of it has already signed, and signing again would "
        "give the key away; make a new one with `palpate keygen`"
    )
    try:
        following, word = _read_state(path / "state.json")
        lines = (path / "journal").read_text(encoding="ascii").splitlines()
        entries = [line.split() for line in lines]
        if any(len(e) != 3 or int(e[0]) != k for k, e in enumerate(entries)):
            raise ValueError
    except (OSError, ValueError, KeyError, TypeError):
        raise SigningError(
            f"the signing state in {path} is damaged, so its next leaf is not known; make a new key with `palpate keygen`"
        ) from None
    # a cut between journal and state leaves the journal one ahead; that leaf counts as used
    if not following <= len(entries) <= following + 1:
        raise stale
    if following and entries[following - 1][1] != word:
        raise stale
    used = len(entries)
    try:
        seen, seen_word = _read_state(witness_directory() / f"{secret.ident.hex()}.json")
    except FileNotFoundError:
        return used  # a machine that has not signed with this key before
    except (OSError, ValueError, KeyError, TypeError):
        raise SigningError(
            f"the record of this key in {witness_directory()} is damaged; make a new key with `palpate keygen`"
        ) from None
    if seen > used or (seen and entries[seen - 1][1] != seen_word):
        raise stale
    return used


def sign(directory: str | os.PathLike[str], make: Callable[[int], bytes]) -> tuple[bytes, Key]:
    """Use one leaf: sign `make(leaf number)` and return message with signature, and the key.

    The leaf is on disk as used before it signs; a failure after that wastes it, which does no harm.

    Raises
    ------
    SigningError
        If the key is missing, damaged, locked, exhausted or copied back, or its state cannot be written.
    """
    path = Path(directory)
    if not (path / "secret.json").is_file():
        load(path)
    try:
        with _locked(path):
            key = load(path)
            if key.used >= key.count:
                raise SigningError(
                    f"the key in {path} is exhausted: all of its {key.count} signatures are used; "
                    "make a new one with `palpate keygen`"
                )
            message = make(key.used)
            word = secrets.token_hex(16)
            _append(path / "journal", f"{key.used} {word} {hashlib.sha256(message).hexdigest()}")
            _write(path / "state.json", _state(key.used + 1, word))
            _witness(key.secret.ident, key.used + 1, word)
            signature = lms_sign.sign(key.secret, _nodes(key), key.used, message, secrets.token_bytes(32))
    except OSError as error:
        raise SigningError(
            f"the signing state in {path} cannot be written: {error.strerror or error}"
        ) from None
    signed = message + signature
    if lms.verify(key.public, lambda at, n: signed[at : at + n], len(signed)) != status.OK:
        raise SigningError(f"the signing key in {path} is damaged: its signature does not verify")
    return signed, Key(path, key.secret, key.public, key.used + 1)


def _nodes(key: Key) -> list[bytes]:
    """The key's tree, from its stored leaves or grown again."""
    try:
        raw = (key.directory / "tree.bin").read_bytes()
    except OSError:
        raw = b""
    leaves = [raw[i : i + 32] for i in range(0, len(raw), 32)]
    if len(raw) == 32 * key.count:
        nodes = lms_sign.tree(key.secret, leaves)
        if nodes[1] == key.public[24:]:
            return nodes
    return lms_sign.tree(key.secret, [lms_sign.leaf_node(key.secret, i) for i in range(key.count)])
