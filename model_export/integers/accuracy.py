"""How far the integers are from float64: worst and median relative error of every output.

The error is relative to the value itself for outputs with a ln link, and for an identity link to the
value or a tenth of the output's range, whichever is larger (E_inv23 runs through zero).
"""

from __future__ import annotations

from array import array
from dataclasses import dataclass, replace

import numpy as np

from firmware_py import evaluator, stage
from firmware_py import features as firmware_features
from palpate.model_export.integers import compiler, reference
from palpate.model_export.schema import OUTPUTS, ModelSpec


@dataclass(frozen=True)
class Errors:
    """Relative errors by output name, of the values and of the intervals' ends, over n vectors."""

    n: int
    median: dict[str, float]
    worst: dict[str, float]
    worst_interval: dict[str, float]
    flags_agree: float


def run(spec: ModelSpec, tables: evaluator.Tables, features: np.ndarray) -> np.ndarray:
    """The evaluator's integers for feature vectors (n x features, feature units): n x OUT_SIZE.

    The lump rule is left out: errors are wanted of strokes without a lump, too.
    """
    x = array("i", [0] * (firmware_features.COUNT + stage.MOST))
    out = array("i", [0] * evaluator.OUT_SIZE)
    ids, head = list(tables.ids), array("i", tables.head)
    head[evaluator.N_LIMITS] = 0
    free = evaluator.Tables(
        tables.ids, tables.feats, tables.steps, tables.c, tables.d, tables.own, tables.rows, tables.outs,
        array("i"), head,
    )  # fmt: skip
    whole = np.round(np.asarray(features) * compiler.Q24).astype(int)
    rows = []
    for row in whole.tolist():
        for ident, value in zip(ids, row):
            x[ident] = value
        free.evaluate(x, out)
        rows.append(out.tolist())
    return np.array(rows)


def measure(spec: ModelSpec, tables: evaluator.Tables, features: np.ndarray) -> Errors:
    """Compare the evaluator with `reference.evaluate` on feature vectors (n x features, feature units)."""
    exact = np.round(np.asarray(features, float) * compiler.Q24) / compiler.Q24
    got = run(spec, tables, exact)
    want = reference.evaluate(spec, exact)
    floor = np.array([0.0 if o.link == "ln" else (o.hi - o.lo) / 10 for o in spec.outputs])

    def error(part: int, name: str) -> np.ndarray:
        size = np.maximum(np.abs(want[name]), floor)
        return np.abs(got[:, part : 3 * evaluator.OUTPUTS : 3] / 1e6 - want[name]) / size

    value = error(0, "value")
    ends = np.maximum(error(1, "low"), error(2, "high"))
    names = [name for name, _ in OUTPUTS]
    flags = got[:, evaluator.FLAGS]
    familiar = reference.evaluate(replace(spec, checks=None), exact)[
        "in_domain"
    ]  # checks have tables of their own
    hardness = np.array(["unsure", "soft", "hard"])[(flags >> 2) & 3]
    agree = (hardness == want["hardness"]) & ((flags & evaluator.IN_DOMAIN > 0) == familiar)
    return Errors(
        len(exact),
        dict(zip(names, np.median(value, axis=0).tolist())),
        dict(zip(names, value.max(axis=0).tolist())),
        dict(zip(names, ends.max(axis=0).tolist())),
        float(np.mean(agree)),
    )
