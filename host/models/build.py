"""How the bundled model is made, and a sample that shows whether it still is what it was."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from palpate.files import whole_file
from palpate.link.events import OUTPUTS
from palpate.model_export.fixed_point import force_map as force_maps
from palpate.model_export.fixed_point.reference import evaluate
from palpate.model_export.schema import ModelSpec
from palpate.models import FIELD, RECIPE, file_hash
from palpate.regression.field.data import prepare
from palpate.regression.field.design import FIELD_SETTINGS, at_forces
from palpate.regression.field.fit import fit_field
from palpate.regression.field.result import FieldFit
from palpate.regression.observed import observe
from palpate.sim.probe.sensors import StrokeField
from palpate.sim.tissue import Case, simulate

MADE: dict[str, Any] = {"lumps": 1024, "rim": 64, "plain": 64, "wide": 32, "noise": "typical", "seed": 1}
"""Arguments of `prepare` and `fit_field`."""

SAMPLE = ("d12h07e20f09", "d08h06e50f08", "d18h05e05f07", "d10h08e02f06")
"""Lumps that the model was not fitted to: one on each side of its ranges' middle."""
SAMPLE_SEED = 7


def build(directory: Path, progress: Callable[[str, int, int], None] | None = None) -> FieldFit:
    """Simulate into `directory` what it lacks, fit, and write model and recipe into this package.

    Parameters
    ----------
    directory : Path
        Strokes that are there already are used.
    progress : callable, optional
        See `palpate.regression.progress.ProgressCallback`.
    """
    counts = {name: MADE[name] for name in ("lumps", "rim", "plain", "wide")}
    strokes = prepare(directory, **counts, progress=progress)
    noise, seed = MADE["noise"], MADE["seed"]
    fit = fit_field(strokes, noise, seed, levels=(noise,), recipes=(), progress=progress)
    with whole_file(FIELD) as part:
        fit.spec.save(part)
    write_recipe(fit.spec, fit.to_dict())
    return fit


def write_recipe(spec: ModelSpec, scores: dict[str, Any]) -> None:
    """Write the recipe that belongs to the model file as it stands."""
    record = {
        "command": "python -m palpate.models out/field",
        "made": MADE,
        "sha256": file_hash(),
        "training": spec.training,
        "scores": scores,
        "sample": sample(spec),
    }
    with whole_file(RECIPE) as part:
        part.write_text(json.dumps(record, indent=1, sort_keys=True) + "\n", encoding="utf-8")


def sample(spec: ModelSpec) -> list[dict[str, Any]]:
    """What the model says of the `SAMPLE` strokes, simulated and observed anew.

    Returns
    -------
    list of dict
        code; `features` by name; for every output value, low, high and truth.
    """
    fields = []
    for code in SAMPLE:
        strokes = (simulate(case, FIELD_SETTINGS) for case in at_forces(Case.from_code(code)))
        fields.append(StrokeField(*strokes))
    blob = None if spec.force_map is None else force_maps.blob(spec.force_map)
    seen = observe(fields, MADE["noise"], SAMPLE_SEED, force_map=blob)
    said = evaluate(spec, seen.columns(spec.features))
    return [
        {
            "code": code,
            "features": dict(zip(spec.features, np.round(seen.columns(spec.features)[k], 6).tolist())),
            **{
                name: {
                    **{part: round(float(said[part][k, j]), 6) for part in ("value", "low", "high")},
                    "truth": round(float(seen.Y[k, j]), 6),
                }
                for j, name in enumerate(OUTPUTS)
            },
        }
        for k, code in enumerate(SAMPLE)
    ]
