"""A fitted model as a file: what `palpate fit` writes as model.json and `palpate export` compiles.

`model_data` says what it consists of and which formulas it stands for.
"""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from palpate.files import json_text, read_limited, whole_file
from palpate.model_export.check import spec as check_spec
from palpate.model_export.errors import ModelError
from palpate.model_export.model_data import (
    Across,
    Domain,
    Estimate,
    FirstStage,
    Interval,
    Joining,
    Layers,
    Limit,
    ModelData,
    Output,
)
from palpate.model_export.vocabulary import KINDS, LINKS, OUTPUTS, Term

__all__ = [
    "KINDS",
    "LINKS",
    "OUTPUTS",
    "Across",
    "Domain",
    "Estimate",
    "FirstStage",
    "Interval",
    "Joining",
    "Layers",
    "Limit",
    "ModelSpec",
    "Output",
    "Term",
]

FORMAT = "palpate-model"
VERSION = 2
LONGEST_INTEGER = 20
"""Digits of the longest integer in model.json, with its sign; no model needs so many."""
LARGEST = 1 << 26
"""Bytes of a model's file; ours have 2 MB."""
DEEPEST = 32
"""Levels of lists and objects in a model, at most; ours have five."""


@dataclass(frozen=True)
class ModelSpec(ModelData):
    """A fitted model (fields: `ModelData`); `validate` says in one sentence what is wrong with it."""

    def validate(self) -> ModelSpec:
        """Check everything that can be checked without the firmware; return self, or raise ModelError."""
        check_spec(self)
        return self

    def to_dict(self) -> dict[str, Any]:
        """Plain dict as written to model.json."""
        body = asdict(self)
        for part in ("first", "checks", "across", "layers"):  # without them as before there were any
            if body[part] is None:
                del body[part]
        for stage in (body.get("first"), body.get("checks"), (body.get("across") or {}).get("width")):
            if stage is not None and stage["joining"] is None:
                del stage["joining"]
        return {"format": FORMAT, "version": VERSION, **body}

    @staticmethod
    def from_dict(data: Any) -> ModelSpec:
        """Model of a parsed model.json; raises ModelError."""
        if not isinstance(data, dict) or data.get("format") != FORMAT:
            raise ModelError('this is not a Palpate model: it has no "format": "palpate-model"')
        if data.get("version") != VERSION:
            raise ModelError(
                f"model.json has version {data.get('version')!r}, this program reads version {VERSION}"
            )
        if _deeper_than(data, DEEPEST):
            raise ModelError("the model is nested too deep: it was not written by palpate fit")
        body = {k: v for k, v in data.items() if k not in ("format", "version")}
        try:
            return _build(ModelSpec, body, "the model").validate()
        except (TypeError, AttributeError, LookupError, OverflowError) as error:
            raise ModelError(f"the model has a part of the wrong shape: {error}") from None

    def save(self, path: str | os.PathLike[str]) -> None:
        """Validate and write model.json; the old file stays whole until the new one is on disk."""
        self.validate()
        try:
            text = json_text(self.to_dict())
        except (ValueError, TypeError) as error:
            raise ModelError(f"the model cannot be written as JSON: {error}") from None
        with whole_file(Path(path)) as temporary:
            temporary.write_text(text + "\n", encoding="utf-8")

    @staticmethod
    def load(path: str | os.PathLike[str]) -> ModelSpec:
        """Read and validate model.json; raises ModelError with one clear sentence."""
        try:
            text = read_limited(Path(path), LARGEST).decode()
        except (OSError, UnicodeDecodeError) as error:
            why = error.strerror if isinstance(error, OSError) else "it is not text"
            raise ModelError(f"cannot read the model {path}: {(why or str(error)).lower()}") from None
        try:
            data = json.loads(text, parse_constant=_no_constant, parse_int=_integer)
        except ValueError as error:
            raise ModelError(f"{path} is not a readable model.json: {error}") from None
        except RecursionError:
            raise ModelError(f"{path} is not a readable model.json: it is nested too deep") from None
        try:
            return ModelSpec.from_dict(data)
        except ModelError as error:
            raise ModelError(f"{path} cannot be used: {error}") from None


def _integer(digits: str) -> int:
    if len(digits) > LONGEST_INTEGER:
        raise ModelError(f"it holds an integer of {len(digits)} digits; no number of a model is so large")
    return int(digits)


def _no_constant(word: str) -> float:
    raise ModelError(f"it holds {word}, which is not a number")


def _deeper_than(value: Any, levels: int) -> bool:
    parts = value.values() if isinstance(value, dict) else value if isinstance(value, list | tuple) else ()
    return levels == 0 or any(
        _deeper_than(part, levels - 1) for part in parts if isinstance(part, dict | list | tuple)
    )


_PARTS: dict[str, Any] = {"outputs": Output, "interval": Interval, "domain": Domain, "lump": Limit,
                           "first": FirstStage, "checks": FirstStage, "estimates": Estimate,
                           "joining": Joining, "across": Across, "width": FirstStage,
                           "layers": Layers}  # fmt: skip
_LISTS = ("outputs", "lump", "estimates")


def _build(cls: Any, data: Any, where: str) -> Any:
    """Dataclass of a dict of JSON: unknown and missing keys are named, lists become tuples."""
    if not isinstance(data, dict):
        raise ModelError(f"{where} must be an object")
    known = {f.name for f in fields(cls)}
    optional = {"force_map", "notes", "first", "checks", "across", "layers", "joining"} | (
        {"lo", "hi"} if cls is Limit else set()
    )
    for key in data:
        if key not in known:
            raise ModelError(f"{where} has the unknown entry {key!r}")
    for key in known - optional:
        if key not in data:
            raise ModelError(f"{where} lacks {key!r}")
    values: dict[str, Any] = {}
    for key, value in data.items():
        part = _PARTS.get(key)
        if part is None or value is None:
            values[key] = value if isinstance(value, dict) else _tuples(value)
        elif key not in _LISTS:
            values[key] = _build(part, value, key)
        elif isinstance(value, list | tuple):
            values[key] = tuple(_build(part, item, f"{key}[{i}]") for i, item in enumerate(value))
        else:
            raise ModelError(f"{key} must be a list")
    return cls(**values)


def _tuples(value: Any) -> Any:
    return tuple(_tuples(v) for v in value) if isinstance(value, list | tuple) else value
