"""The models that come with Palpate, signed for emulated probes: with a key of this machine's, which no real
probe trusts."""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

from palpate import models
from palpate.files import whole_file
from palpate.model_export.errors import SigningError
from palpate.model_export.exporter import export
from palpate.model_export.signing import keys


def public_key() -> bytes:
    """The key that an emulated probe trusts where its user names none."""
    return (_key() / "public.key").read_bytes()


def image(name: str = models.FIELD) -> bytes:
    """Of `models.NAMES`; signed once, and kept."""
    path = _folder() / f"{name}-{models.file_hash(models.path(name))[:16]}-{public_key().hex()[-8:]}.palp"
    if path.exists():
        return path.read_bytes()
    try:
        image, _ = export(models.load(name), _key(), force=True)
    except SigningError:  # of an older kind, or damaged
        shutil.rmtree(_key())
        image, _ = export(models.load(name), _key(), force=True)
    with whole_file(path) as part:
        part.write_bytes(image)
    return image


def _key() -> Path:
    """The key's directory; made beside its place and moved there, so that two emulators may start at once."""
    key = _folder() / "key"
    if not key.exists():
        with tempfile.TemporaryDirectory(dir=_folder()) as made:
            keys.generate(Path(made) / "key")
            try:
                (Path(made) / "key").rename(key)
            except OSError:
                if not key.exists():  # else another emulator was quicker
                    raise
    return key


def _folder() -> Path:
    root = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    folder = Path(root) / "palpate" / "emulator"
    folder.mkdir(parents=True, exist_ok=True)
    return folder
