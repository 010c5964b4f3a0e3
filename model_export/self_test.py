"""The vectors that travel in an image, with which a probe tries it before it confirms it."""

from __future__ import annotations

import struct
from array import array

import numpy as np

from firmware_py import evaluator, stage
from firmware_py import features as firmware_features
from firmware_py import model_image as fw
from palpate.model_export.errors import ModelError
from palpate.model_export.integers import compiler, sampling
from palpate.model_export.schema import ModelSpec

SELF_TESTS = 2


def vectors(spec: ModelSpec, tables: evaluator.Tables) -> tuple[dict[int, int], list[list[int]]]:
    """Inputs of the self-test: values of features that only the lump rule looks at, and vectors.

    The vectors lie inside the domain and pass the lump rule; each has one byte per feature
    (`model_image.place`).

    Raises
    ------
    ModelError
        If the lump rule and the domain leave nothing in common.
    """
    extra = {}
    for ident, limit in zip(compiler.feature_ids([r.feature for r in spec.lump]), spec.lump):
        if limit.feature not in spec.features:
            lo = -31.0 if limit.lo is None else limit.lo
            hi = 31.0 if limit.hi is None else limit.hi
            extra[ident] = round((lo + hi) / 2 * compiler.Q24)
    found: list[list[int]] = []
    for row in np.round(sampling.in_domain(spec, 2000, seed=7) * compiler.Q24).astype(int).tolist():
        feats = tables.feats
        vector = []
        for i, value in enumerate(row):
            lo, hi = feats[7 * i], feats[7 * i + 1]
            vector.append(min(max(256 * (value - lo) // max(hi - lo, 1), 0), 255))
        out = estimate(tables, extra, vector)
        if out[evaluator.FLAGS] & 3 == 3:
            found.append(vector)
        if len(found) == SELF_TESTS:
            return extra, found
    raise ModelError("the model's lump rule and its domain leave nothing in common")


def estimate(tables: evaluator.Tables, extra: dict[int, int], vector: list[int]) -> list[int]:
    """What the probe makes of a self-test vector."""
    x = array("i", [0] * (firmware_features.COUNT + stage.MOST))
    for ident, value in extra.items():
        x[ident] = value
    for i, ident in enumerate(tables.ids):
        x[ident] = fw.place(tables.feats, i, vector[i])
    out = array("i", [0] * evaluator.OUT_SIZE)
    tables.evaluate(x, out)
    return out.tolist()


def of_first_stage(first: stage.Stage) -> tuple[bytes, bytes]:
    """A vector of the first stage, one byte a feature, and the values that it must give."""
    vector = bytes(64 + 37 * i % 128 for i in range(len(first.ids)))
    x = array("i", [0] * first.feature_count)
    for i, ident in enumerate(first.ids):
        x[ident] = fw.place(first.feats, i, vector[i])
    values = first.extend(x)[first.feature_count :][: first.count]
    return vector, values.tobytes()


def padded(raw: bytes) -> bytes:
    """A section with zeros up to a multiple of four bytes."""
    return raw + bytes(-len(raw) % 4)


def section(tables: evaluator.Tables, extra: dict[int, int], vectors: list[list[int]]) -> bytes:
    """The image's section: the vectors and the integers that each must give."""
    raw = padded(bytes((len(vectors), len(extra), *extra)))
    raw += struct.pack(f"<{len(extra)}i", *extra.values())
    raw = padded(raw + bytes(v for vector in vectors for v in vector))
    for vector in vectors:
        raw += struct.pack(f"<{fw.TESTED}i", *estimate(tables, extra, vector)[: fw.TESTED])
    return raw
