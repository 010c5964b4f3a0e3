"""Signing keys on disk.

A key directory holds

    secret.json    seeds and set (mode 600): whoever has this file signs as its owner
    public.key     for the probe
    counter.json   the last security counter given, so that two images of one minute have an order
    succession.palp  what makes a probe take this key in another one's place, where it was made for that

SLH-DSA keeps no state: nothing here counts what was signed, so that a copy of the directory, in a backup, on
another machine or in two programs at once, signs as safely as the original. The security counter is no
part of the signature. It is the minutes since 2024 began (or $SOURCE_DATE_EPOCH's), or one more than the
last one given: the homes of a key need not know of each other. So one clock that runs ahead would lock the
other homes out: it is believed no further than `AHEAD_S` beyond what was seen.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from firmware_py import keyring, model_image, signature, status
from palpate.model_export.errors import SigningError
from palpate.model_export.signing import key_files as files
from palpate.model_export.signing import slh_sign as scheme

EPOCH_S = 1704067200
"""2024-01-01T00:00Z."""

AHEAD_S = 86400
"""How far the clock may be past the newest of key, last export and model, seconds."""

SUCCESSION = "succession.palp"

_NO_TIME_S = 1e11  # the year 5138

PROGRAM = b"palpate program"
"""What such a signature is for, beside signature.MODEL and SUCCESSOR."""
MAX_COUNTER = model_image.MAX_COUNTER
"""In minutes, the year 4065."""


@dataclass(frozen=True)
class Key:
    """A key directory, read; `counter` is the last security counter it has given, 0 before the first."""

    directory: Path
    secret: scheme.Secret
    public: bytes
    counter: int


def generate(
    directory: str | os.PathLike[str],
    secret: scheme.Secret | None = None,
    succeeds: str | os.PathLike[str] | None = None,
    force: bool = False,
) -> bytes:
    """Make a signing key in a new directory (`palpate keygen`); returns the public key.

    Parameters
    ----------
    directory : path
        Must not hold a key yet.
    secret : Secret, optional
        For tests; otherwise drawn from the operating system.
    succeeds : path, optional
        The key that it takes the place of: `succession.palp` is written too.
    force : bool
        As `succeed` takes it.

    Raises
    ------
    SigningError
        If the directory cannot be written or already holds a key.
    """
    path = Path(directory)
    secret = scheme.Secret.draw() if secret is None else secret
    public = scheme.public_key(secret)
    content = {"format": "palpate-signing-key", "version": 2, **secret.content}
    succession = None if succeeds is None else succeed(succeeds, public, force=force)
    try:
        path.mkdir(parents=True, exist_ok=True)
        with files.alone(path):
            if (path / "secret.json").exists():
                raise SigningError(f"{path} already holds a signing key; choose another directory")
            files.write(path / "public.key", public)
            if succession is not None:
                files.write(path / SUCCESSION, succession)
            # last, so that a directory without it is no key
            files.write(path / "secret.json", json.dumps(content, indent=1).encode() + b"\n", 0o600)
    except OSError as error:
        raise SigningError(f"the key cannot be written to {path}: {error.strerror or error}") from None
    return public


def load(directory: str | os.PathLike[str]) -> Key:
    """Read a key directory; SigningError if it is missing, damaged or of the old kind."""
    path = Path(directory)
    try:
        data = json.loads((path / "secret.json").read_text())
        if data["format"] != "palpate-signing-key":
            raise ValueError
        if data["version"] == 1:
            raise SigningError(
                f"the key in {path} is of the old kind (LMS), whose copies could be made to sign forgeries; "
                "make a new one with `palpate keygen` and give the probe its public key"
            )
        public = (path / "public.key").read_bytes()
        secret = scheme.Secret.read(data, public)
        if data["version"] != 2:
            raise ValueError
    except FileNotFoundError:
        raise SigningError(f"{path} holds no signing key; make one with `palpate keygen {path}`") from None
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        raise SigningError(
            f"the signing key in {path} is damaged; copy it back from a backup, or make a new one with "
            "`palpate keygen`"
        ) from None
    return Key(path, secret, public, _last_counter(path))


def _last_counter(path: Path) -> int:
    try:
        last = json.loads((path / "counter.json").read_text())["last"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return 0
    return last if type(last) is int and 0 <= last <= MAX_COUNTER else 0


def _now_s() -> float:
    """Seconds since 1970, by $SOURCE_DATE_EPOCH where it is set."""
    told = os.environ.get("SOURCE_DATE_EPOCH")
    try:
        now = float(told) if told else time.time()
    except ValueError:
        now = math.nan
    if not abs(now) < _NO_TIME_S:
        raise SigningError("SOURCE_DATE_EPOCH must be a number of seconds since 1970")
    return now


def _clock_s(directory: Path, seen_s: float, force: bool) -> float:
    """The clock, if it is not far ahead of all that was seen: the key's files, its last export, `seen_s`."""
    now = _now_s()
    seen = [seen_s, EPOCH_S + 60.0 * _last_counter(directory)]
    for name in ("secret.json", "public.key", "counter.json"):
        with contextlib.suppress(OSError):
            seen.append((directory / name).stat().st_mtime)
    if now - max(seen) > AHEAD_S and not force:
        raise SigningError(
            f"the clock says {_date(now)}, and what was seen last here is of {_date(max(seen))}; signed by a "
            "clock that runs ahead, an image locks all later ones out: set the clock or, if it is right, "
            "give --force"
        )
    return now


def _date(seconds: float) -> str:
    return time.strftime("%Y-%m-%d %H:%M", time.gmtime(seconds))


def sign(
    directory: str | os.PathLike[str],
    make: Callable[[int], bytes],
    counter: int | None = None,
    seen_s: float = 0.0,
    force: bool = False,
) -> tuple[bytes, Key]:
    """Sign `make(security counter)`; returns message with signature, and the key.

    Parameters
    ----------
    directory : path
    make : callable
        Gives the message for a counter.
    counter : int, optional
        In place of the next one.
    seen_s : float
        A time that has passed for certain, seconds since 1970: that of the model's file.
    force : bool
        Believe the clock, however far it is past `seen_s` and the key's own files.

    Raises
    ------
    SigningError
        If the key is missing or damaged, its signature does not verify, or the clock runs ahead.
    """
    key = load(directory)
    if counter is None:
        minutes = int((_clock_s(key.directory, seen_s, force) - EPOCH_S) // 60)
        counter = min(max(key.counter + 1, minutes), MAX_COUNTER)
    message = make(counter)
    signed = _signed(key, message, signature.MODEL)
    # only an order within a minute hangs on it: a directory that cannot be written may sign all the same
    with contextlib.suppress(OSError):
        files.write(key.directory / "counter.json", json.dumps({"last": counter}).encode() + b"\n")
    return signed, Key(key.directory, key.secret, key.public, counter)


def succeed(
    old: str | os.PathLike[str], new: bytes, moment_ns: int | None = None, force: bool = False
) -> bytes:
    """What makes a probe take the models of another public key: that key, signed by the old one.

    Parameters
    ----------
    old : path
        The old key's directory.
    new : bytes
        The new public key.
    moment_ns : int, optional
        Since 1970, in place of the clock: a probe takes none that is not younger than its last one.
    force : bool
        As `sign` takes it.
    """
    key = load(old)
    if moment_ns is None:
        moment_ns = int(1e9 * _clock_s(key.directory, 0.0, force))
        with contextlib.suppress(OSError):  # the one that brought this key is older, whatever the clock said
            named = (key.directory / SUCCESSION).read_bytes()[len(keyring.SUCCESSION) :][: keyring.MOMENT]
            moment_ns = min(max(moment_ns, 1 + int.from_bytes(named, "big")), 256**keyring.MOMENT - 1)
    message = keyring.SUCCESSION + max(moment_ns, 1).to_bytes(keyring.MOMENT, "big") + new
    return _signed(key, message, signature.SUCCESSOR)


def sign_program(directory: str | os.PathLike[str], module: bytes) -> bytes:
    """A compiled regression's .mpy (`palpate.fixedpoint`) and its signature, which no loader reads.

    A board checks it by `signature.verify(key, read, size, PROGRAM)`; no probe takes it for a model. It has
    no counter: an older one that was signed is as good as a newer.

    Raises
    ------
    SigningError
        If the key is missing or damaged, or its signature does not verify.
    """
    return _signed(load(directory), module, PROGRAM)


def _signed(key: Key, message: bytes, context: bytes) -> bytes:
    """The message and its signature, which verifies."""
    signed = message + scheme.sign(key.secret, key.public, message, context)
    if signature.verify(key.public, lambda at, n: signed[at : at + n], len(signed), context) != status.OK:
        raise SigningError(
            f"the signing key in {key.directory} is damaged: its signature does not verify; copy it back "
            "from a backup"
        )
    return signed
