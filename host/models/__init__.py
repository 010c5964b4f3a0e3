"""The models that come with Palpate, fitted, with their recipes, hashes and scores.

    from palpate import models

    spec = models.load()                   # endless cylinders in tissue of all kinds (plane strain)
    balls = models.load("balls")           # balls and ellipsoids in tissue of all kinds: real lumps
    anywhere = models.load("anywhere")     # the same anywhere, not only on the border of fat and gland
    told = models.load("thesis-tissue")    # told that the tissue is the thesis'; does without the press
    models.recipe()["scores"]              # how good it is on lumps that it never saw

`python -m palpate.models NAME DIRECTORY` rebuilds one's two files.
"""

from __future__ import annotations

import json
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from firmware_py import geometry
from palpate.model_export.schema import ModelSpec

if TYPE_CHECKING:
    from palpate.sim.tissue import Case

FIELD, BALLS, ANYWHERE, TOLD = "field", "balls", "anywhere", "thesis-tissue"
NAMES = (FIELD, BALLS, ANYWHERE, TOLD)


def path(name: str = FIELD) -> Path:
    """Where the model of this name lies."""
    return Path(__file__).with_name(f"{name.replace('-', '_')}.json")


def recipe_path(name: str = FIELD) -> Path:
    """Where its recipe lies."""
    return path(name).with_suffix(".recipe.json")


def load(name: str = FIELD) -> ModelSpec:
    """A model as it ships: `thesis-tissue` was told the thesis', the others are for tissue of all kinds."""
    return ModelSpec.load(path(name))


def trained_on(training: str) -> ModelSpec | None:
    """The model that was fitted to the training set of this hash, 64 hex digits; None if none of them was."""
    for name in NAMES:
        if training in path(name).read_text(encoding="utf-8"):  # much quicker than to read them as models
            found = load(name)
            if found.training["hash"] == training:
                return found
    return None


def suited_to(case: Case) -> str:
    """The name of the model for such a lump, in whatever tissue."""
    return BALLS if case.solid else FIELD if case.fat_mm is None else ANYWHERE


def suits_array() -> bool:
    """Are they for the sensor array in use?"""
    return load().probe == geometry.NAME.decode()


def recipe(name: str = FIELD) -> dict[str, Any]:
    """How it was made (`made`), its file's hash (`sha256`), held-out `scores`, and a `sample` to check it
    on."""
    found: dict[str, Any] = json.loads(recipe_path(name).read_text(encoding="utf-8"))
    return found


def file_hash(of: Path) -> str:
    """SHA-256 of a model's file, in hexadecimal."""
    return sha256(of.read_bytes()).hexdigest()


def emulator_path() -> Path:
    """Where the emulator of strokes over solid lumps lies (`palpate.learn.emulator_file`)."""
    return Path(__file__).with_name("balls.emulator.npz")


def plane_emulator_path() -> Path:
    """Where the emulator of frames over cylinders lies (`palpate.learn.plane_emulator`)."""
    return Path(__file__).with_name("plane.emulator.npz")
