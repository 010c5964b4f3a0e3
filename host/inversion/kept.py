"""Answers kept beside the recording that they are of: visit.mcap has visit.mcap.refined.

The recording itself is left as it was sealed. An answer is known by hashes of the data that it came from, of
the inversion that found it, and of class and noise; where one is another, it is found again.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, astuple
from functools import lru_cache
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from palpate import models
from palpate.answer.fitted import Inverted, Laid
from palpate.errors import PalpateError
from palpate.files import read_whole, whole_file, writing_alone
from palpate.inversion.felt import FeltStroke, NotInvertible
from palpate.inversion.recorded import felt_strokes
from palpate.inversion.start import Start
from palpate.sim.probe.noise import Noise
from palpate.sim.tissue import SOLVER_VERSION
from palpate.sim.tissue.settings import FINE_SOLVER_VERSION, SOLID_SOLVER_VERSION

Felt = tuple[FeltStroke, Start]
"""A stroke and a first estimate of what lies under it."""

SUFFIX = ".refined"
_FORMAT, _VERSION = "palpate refined strokes", 1
_MOST = 1 << 28
_DIGITS = 6
"""Sums of floats may end otherwise on another processor."""


class Kept:
    """The answers beside one recording.

    Parameters
    ----------
    recording : Path
        It need not be there yet.

    Attributes
    ----------
    path : Path
        Where they are kept.

    Raises
    ------
    PalpateError
        Something else lies there.
    """

    def __init__(self, recording: Path) -> None:
        self.path = Path(f"{recording}{SUFFIX}")
        self._entries = self._read()

    @property
    def outdated(self) -> bool:
        """Whether another version of the inversion has found some of them."""
        return any(entry["of"]["inversion"] != version() for entry in self._entries)

    def find(self, strokes: Sequence[Felt], noise: Noise, kind: str) -> Inverted | None:
        """The answer to these strokes together, by this inversion under this class and noise."""
        return self._answer(_name(strokes, noise, kind))

    def newest(self, strokes: Sequence[Felt]) -> Inverted | None:
        """The same under whatever class and noise it was asked for last."""
        return self._answer({"strokes": _data(strokes), "inversion": version()})

    def keep(self, strokes: Sequence[Felt], noise: Noise, kind: str, answer: Inverted) -> None:
        """Keep an answer beside the others; those of another version of the inversion go.

        Raises
        ------
        PalpateError
            The file cannot be written, or a number of the answer is not finite; what was there is untouched.
        """
        name = _name(strokes, noise, kind)
        kept = {"of": name, "answer": answer.as_dict(), "laid": [one.as_dict() for one in answer.laid]}
        try:
            json.dumps(kept, allow_nan=False)
        except ValueError:
            raise PalpateError(
                f"stroke {answer.stroke} is not kept: a number of its answer is none"
            ) from None
        with writing_alone(self.path):
            others = [entry for entry in self._read() if entry["of"] != name]
            self._entries = [entry for entry in others if entry["of"]["inversion"] == version()] + [kept]
            document = {"format": _FORMAT, "version": _VERSION, "answers": self._entries}
            with whole_file(self.path) as temporary:
                temporary.write_text(json.dumps(document), encoding="utf-8")

    def _answer(self, name: dict[str, str]) -> Inverted | None:
        for entry in reversed(self._entries):
            if name.items() <= entry["of"].items():
                laid = tuple(Laid.from_dict(one) for one in entry["laid"])
                return Inverted.from_dict(entry["answer"] | {"laid": laid})
        return None

    def _read(self) -> list[dict[str, Any]]:
        if not self.path.exists():
            return []
        try:
            document = json.loads(read_whole(self.path, "file of refined answers", _MOST))
            if document["format"] != _FORMAT or document["version"] != _VERSION:
                raise ValueError
            entries: list[dict[str, Any]] = document["answers"]
            for entry in entries:
                entry["of"]["inversion"], entry["answer"]["class"], entry["laid"]
        except (ValueError, KeyError, TypeError):
            raise PalpateError(
                f"{self.path} holds no refined answers that this version can read; move it away and try again"
            ) from None
        return entries


def kept_answers(recording: Path) -> list[Inverted]:
    """Those kept of a recording, stroke by stroke, or press by press; without what was never refined.

    Raises
    ------
    PalpateError
        As `Kept`, and the recording cannot be read.
    """
    kept = Kept(recording)
    if not kept.path.exists():
        return []
    found = (
        Inverted(start.stroke, problem=str(stroke))
        if isinstance(stroke, NotInvertible)
        else kept.newest([(stroke, start)])
        for stroke, start in felt_strokes(recording)
    )
    return [answer for answer in found if answer is not None]


@lru_cache(maxsize=1)
def version() -> str:
    """Hash of the inversion's source, of its models and emulators, and the solvers' versions."""
    own = files("palpate.inversion")
    names = sorted(one.name for one in own.iterdir() if one.name.endswith(".py"))
    parts = [(own / name).read_bytes() for name in names]
    emulators = models.emulator_path(), models.plane_emulator_path()
    learnt = models.path(models.ANYWHERE), models.path(models.BALLS), *emulators
    parts += [models.file_hash(path).encode() for path in learnt]
    parts += [one.encode() for one in (SOLVER_VERSION, FINE_SOLVER_VERSION, SOLID_SOLVER_VERSION)]
    return _hash(*parts)


def _name(strokes: Sequence[Felt], noise: Noise, kind: str) -> dict[str, str]:
    spread = json.dumps(asdict(noise), sort_keys=True).encode()
    return {"strokes": _data(strokes), "inversion": version(), "class": kind, "noise": _hash(spread)}


def _data(strokes: Sequence[Felt]) -> str:
    parts = []
    for stroke, start in strokes:
        for value in (*vars(stroke).values(), *astuple(start)):
            number = np.ndim(value) or isinstance(value, (int, float))
            rounded = np.round(np.asarray(value, float), _DIGITS) + 0.0 if number else None
            parts.append(repr(value).encode() if rounded is None else rounded.tobytes())
    return _hash(*parts)


def _hash(*parts: bytes) -> str:
    return sha256(b"".join(sha256(part).digest() for part in parts)).hexdigest()[:32]
