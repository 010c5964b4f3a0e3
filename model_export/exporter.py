"""From a model to a signed image: compile, prove, measure, build, sign."""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from firmware_py import signature
from palpate.model_export import image_builder
from palpate.model_export.errors import ModelError
from palpate.model_export.integers import accuracy, bounds, compiler, sampling
from palpate.model_export.integers.force_map import blob as pack_force_map
from palpate.model_export.schema import ModelSpec
from palpate.model_export.signing import keys


@dataclass(frozen=True)
class Report:
    """What `palpate export` prints.

    Attributes
    ----------
    model_id : str
        Hex.
    size, signature_size : int
        Bytes of the image, and of the signature in it.
    counter, replaces : int
        Security counter; for a rollback the highest counter it may replace, else 0.
    errors : accuracy.Errors
        Against float64, over `over`.
    over : str
        "the training set" or "random vectors of the domain".
    proof : bounds.Proof
    adapted : str
        From what it was adapted to real strokes; "" if it was not.
    """

    model_id: str
    size: int
    signature_size: int
    counter: int
    replaces: int
    errors: accuracy.Errors
    over: str
    proof: bounds.Proof
    adapted: str = ""

    def to_dict(self) -> dict[str, Any]:
        """For --json."""
        return asdict(self) | {"headroom_bits": self.proof.headroom_bits}

    def lines(self) -> list[str]:
        """For people."""
        worst = max(self.errors.worst, key=lambda name: self.errors.worst[name])
        return [
            f"model {self.model_id}: {self.size} bytes signed ({self.signature_size} of them signature), "
            f"security counter {self.counter}"
            + (f", rollback of up to {self.replaces}" if self.replaces else ""),
            f"worst error against float64 over {self.over} (n = {self.errors.n}): "
            f"{self.errors.worst[worst]:.1e} in {worst}; "
            f"medians at most {max(self.errors.median.values()):.1e}",
            str(self.proof),
            *([self.adapted] if self.adapted else []),
        ]


def prepare(spec: ModelSpec) -> tuple[Any, bounds.Proof, bytes | None]:
    """Tables, proof and force map's blob of a model; ModelError or ProofError if it cannot be one."""
    tables = compiler.compile_model(spec)
    proof = bounds.prove(tables)
    stages = [] if spec.first is None else [compiler.compile_first(spec.first)]
    checks = compiler.compile_checks(spec)
    for part in stages if checks is None else [*stages, checks]:
        proof = max(proof, bounds.prove_first(part), key=lambda p: p.largest)
    blob = None
    if spec.force_map is not None:
        try:
            blob = pack_force_map(spec.force_map)
        except (ValueError, KeyError, TypeError) as error:
            raise ModelError(f"the model's force map cannot be packed: {error}") from None
    return tables, proof, blob


def training_features(spec: ModelSpec) -> np.ndarray | None:
    """Feature vectors of the training set, if the model holds them (training["features"], n x features)."""
    rows = spec.training.get("features")
    if not rows:
        return None
    try:
        table = np.array(rows, float)
    except ValueError:
        table = np.zeros(0)
    if table.ndim != 2 or table.shape[1] != len(spec.features):
        raise ModelError('training["features"] must have a row of all features for each stroke')
    limit = 2.0**5 - 2.0**-23
    return np.clip(table, -limit, limit)


def export(
    spec: ModelSpec,
    key_dir: str | os.PathLike[str],
    counter: int | None = None,
    rollback: bool = False,
    features: np.ndarray | None = None,
    held: int = 0,
    seen_s: float = 0.0,
    force: bool = False,
    info: bytes | None = None,
) -> tuple[bytes, Report]:
    """Signed image of a model, and a report.

    Parameters
    ----------
    spec : ModelSpec
    key_dir : path
        Directory made by `keys.generate`.
    counter : int, optional
        Security counter; by default from the clock, so that a later image is newer (see `keys`).
    rollback : bool
        Sign the image as one that may replace any that this key has signed so far.
    features : array, optional
        Feature vectors (n x features) for the error report; by default the training set's, if the model
        brings them, else 2000 random vectors of the domain.
    held : int
        Of a rollback: the counter that a probe holds, where another home of the key has signed its model.
    seen_s, force : float, bool
        Whether to believe the clock, as `keys.sign` takes them.
    info : bytes, optional
        As `image_builder.build` takes it.

    Raises
    ------
    ModelError, ProofError, SigningError
        Before anything is signed, except where signing itself fails.
    """
    tables, proof, blob = prepare(spec)
    over = "the training set"
    if features is None:
        features = training_features(spec)
    if features is None:
        features = sampling.in_domain(spec, 2000)
        over = "random vectors of the domain"
    errors = accuracy.measure(spec, tables, features)

    def make(own: int) -> bytes:
        return image_builder.build(spec, tables, blob, own, max(last, own, held) if rollback else 0, info)

    last = keys.load(key_dir).counter
    signed, key = keys.sign(key_dir, make, counter, seen_s, force)
    found = image_builder.inspect(signed, key.public, spec.probe)
    report = Report(
        found.model_id,
        len(signed),
        signature.size(key.public),
        found.counter,
        found.replaces,
        errors,
        over,
        proof,
        found.adapted,
    )
    return signed, report
