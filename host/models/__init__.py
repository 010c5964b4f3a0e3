"""The bundled model: a fitted field model that comes with Palpate, with its recipe, hash and scores.

    from palpate import models

    spec = models.load()          # what `palpate.export` compiles and signs
    models.recipe()["scores"]     # how good it is on lumps that it never saw

`python -m palpate.models DIRECTORY` rebuilds both files.
"""

from __future__ import annotations

import json
from hashlib import sha256
from pathlib import Path
from typing import Any

from firmware_py import geometry
from palpate.model_export.schema import ModelSpec

FIELD = Path(__file__).with_name("field.json")
RECIPE = Path(__file__).with_name("field.recipe.json")


def load() -> ModelSpec:
    """The field model as it ships."""
    return ModelSpec.load(FIELD)


def suits_array() -> bool:
    """Is it for the sensor array in use?"""
    return load().probe == geometry.NAME.decode()


def recipe() -> dict[str, Any]:
    """How it was made (`made`), its file's hash (`sha256`), held-out `scores`, and a `sample` to check it
    on."""
    found: dict[str, Any] = json.loads(RECIPE.read_text(encoding="utf-8"))
    return found


def file_hash(path: Path = FIELD) -> str:
    """SHA-256 of a model's file, in hexadecimal."""
    return sha256(path.read_bytes()).hexdigest()
