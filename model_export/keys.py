"""Signing keys on disk. An LMS key signs once with each leaf, so its state outlives everything here.

A key directory holds

    secret.json    seed, identifier, parameters (mode 600)
    tree.bin       the tree's leaves (public; saves growing them again)
    public.key     for the probe
    state.json     the next unused leaf, and a random word that changes with every signature
    journal        one line for every leaf used: number, random word, hash of what it signed

Before a signature leaves, the journal and then the state are on disk (fsync of file and directory).
A directory that was copied back from a backup holds a state, or a journal, older than a leaf already
used; the two are checked against each other, and against a third record outside the directory, in
the user's own state directory, without which a key that has signed must be adopted. Using a leaf twice
would let anyone forge signatures, so when in doubt the key is refused and a new one must be made.
"""

from __future__ import annotations

import hashlib
import json
import os
import secrets
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from firmware_py import lms, status
from model_export import key_files as files
from model_export import lms_sign
from model_export.errors import SigningError


def generate(
    directory: str | os.PathLike[str],
    height: int = 10,
    width: int = 8,
    size: int = 24,
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
        4 or 8 bits a digit; 8 gives shorter signatures that take longer to verify.
    size : int
        24 or 32 bytes a node: signatures of 900 or 1452 bytes (height 10, width 8). 24 is RFC 9858's
        and NIST SP 800-208's shorter set, SHA-256 cut to 192 bits.
    progress : callable, optional
        Called with the leaves done and all leaves.
    secret : Secret, optional
        For tests; otherwise drawn from the operating system.

    Raises
    ------
    SigningError
        If the directory cannot be written or already holds a key.
    """
    if (size, height) not in lms_sign.HEIGHTS or (size, width) not in lms_sign.WIDTHS:
        raise SigningError("a key has a height of 5, 10 or 15, a width of 1, 2, 4 or 8, a size of 24 or 32")
    path = Path(directory)
    try:
        path.mkdir(parents=True, exist_ok=True)
        if (path / "secret.json").exists():
            raise SigningError(f"{path} already holds a signing key; choose another directory")
        if secret is None:
            secret = lms_sign.Secret(secrets.token_bytes(size), secrets.token_bytes(16), height, width, size)
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
            "size": secret.size,
        }
        word = secrets.token_hex(16)
        files.write(path / "tree.bin", b"".join(leaves))
        files.write(path / "public.key", public)
        files.write(path / "journal", b"")
        files.write(path / "state.json", files.state(0, word))
        files.write_witness(secret.ident, 0, word)
        # last, so that a directory without it is no key
        files.write(path / "secret.json", json.dumps(content, indent=1).encode() + b"\n", 0o600)
    except OSError as error:
        raise SigningError(f"the key cannot be written to {path}: {error.strerror or error}") from None
    return public


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


def load(directory: str | os.PathLike[str], adopt: bool = False) -> Key:
    """Read a key directory; SigningError if it is missing, damaged or copied back."""
    path = Path(directory)
    try:
        data = json.loads((path / "secret.json").read_text())
        if data["format"] != "palpate-signing-key" or data["version"] != 1:
            raise ValueError
        secret = lms_sign.Secret(
            bytes.fromhex(data["seed"]),
            bytes.fromhex(data["ident"]),
            data["height"],
            data["width"],
            data.get("size", 32),
        )
        public = (path / "public.key").read_bytes()
        good = public[:24] == secret.types + secret.ident and len(public) == 24 + secret.size
        if not good or len(secret.seed) != secret.size or not lms.parameters(public):
            raise ValueError
    except FileNotFoundError:
        raise SigningError(f"{path} holds no signing key; make one with `palpate keygen {path}`") from None
    except (OSError, ValueError, KeyError, TypeError, AssertionError):
        raise SigningError(
            f"the signing key in {path} is damaged; make a new one with `palpate keygen`"
        ) from None
    return Key(path, secret, public, _used(path, secret, adopt))


def _journal(path: Path) -> str:
    """The journal; a last line that a power cut tore counts as a leaf used, and is made whole."""
    text = (path / "journal").read_text(encoding="ascii")
    if text and not text.endswith("\n"):
        lines = text.split("\n")
        text = "".join(line + "\n" for line in lines[:-1]) + f"{len(lines) - 1} torn torn\n"
    return text


def _used(path: Path, secret: lms_sign.Secret, adopt: bool) -> int:
    """Leaves used; refuses a directory whose records do not agree with each other and with the witness."""
    stale = SigningError(
        f"the key in {path} was copied back: a newer state of it has already signed, and signing again would "
        "give the key away; make a new one with `palpate keygen`"
    )
    try:
        following, word = files.read_state(path / "state.json")
        entries = [line.split() for line in _journal(path).splitlines()]
        if any(len(e) != 3 or int(e[0]) != k for k, e in enumerate(entries)):
            raise ValueError
    except (OSError, ValueError, KeyError, TypeError):
        raise SigningError(
            f"the signing state in {path} is damaged, so its next leaf is not known; "
            "make a new key with `palpate keygen`"
        ) from None
    # a cut between journal and state leaves the journal one ahead; that leaf counts as used
    if not following <= len(entries) <= following + 1:
        raise stale
    if following and entries[following - 1][1] != word:
        raise stale
    used = len(entries)
    try:
        seen, seen_word = files.read_state(files.witness_file(secret.ident))
    except FileNotFoundError:
        if used and not adopt:
            raise SigningError(
                f"this machine has no record of the key in {path}, which has signed {used} times "
                "elsewhere; if this is its only copy adopt it once (`--adopt`), otherwise make a new one"
            ) from None
        return used
    except (OSError, ValueError, KeyError, TypeError):
        raise SigningError(
            f"the record of this key in {files.witness_directory()} is damaged; make a new key with "
            "`palpate keygen`"
        ) from None
    if seen > used or (seen and entries[seen - 1][1] != seen_word):
        raise stale
    return used


def sign(
    directory: str | os.PathLike[str], make: Callable[[int], bytes], adopt: bool = False
) -> tuple[bytes, Key]:
    """Use one leaf: sign `make(leaf number)` and return message with signature, and the key.

    The leaf is on disk as used before it signs; a failure after that wastes it, which does no harm.

    Raises
    ------
    SigningError
        If the key is missing, damaged, locked, exhausted or copied back, or its state cannot be written.
    """
    path = Path(directory)
    if not (path / "secret.json").is_file():
        load(path)  # says that there is none
    try:
        with files.locked(path):
            key = load(path, adopt)
            if key.used >= key.count:
                raise SigningError(
                    f"the key in {path} is exhausted: all of its {key.count} signatures are used; "
                    "make a new one with `palpate keygen`"
                )
            message = make(key.used)
            word = secrets.token_hex(16)
            whole = _journal(path)
            if whole != (path / "journal").read_text(encoding="ascii"):
                files.write(path / "journal", whole.encode("ascii"))
            files.append(path / "journal", f"{key.used} {word} {hashlib.sha256(message).hexdigest()}")
            files.write(path / "state.json", files.state(key.used + 1, word))
            files.write_witness(key.secret.ident, key.used + 1, word)
            signature = lms_sign.sign(
                key.secret, _nodes(key), key.used, message, secrets.token_bytes(key.secret.size)
            )
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
    size = key.secret.size
    leaves = [raw[i : i + size] for i in range(0, len(raw), size)]
    if len(raw) == size * key.count:
        nodes = lms_sign.tree(key.secret, leaves)
        if nodes[1] == key.public[24:]:
            return nodes
    return lms_sign.tree(key.secret, [lms_sign.leaf_node(key.secret, i) for i in range(key.count)])
