"""The model of two stages as the document that `palpate export` compiles."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from palpate.learn.any_tissue.model import ESTIMATES, TissueModel
from palpate.learn.any_tissue.observed import FORCE_N_PER_M
from palpate.learn.any_tissue.reference import Joining
from palpate.learn.probe_model import Polynomial, estimates_of, floats, spec_of, stage_of
from palpate.model_export import model_data
from palpate.model_export.schema import Across, FirstStage, Layers, ModelSpec


def tissue_spec(
    model: TissueModel,
    joining: Joining,
    training: dict[str, Any],
    force_map: dict[str, Any] | None,
    checks: FirstStage | None = None,
    across: Across | None = None,
    layers: Layers | None = None,
    **notes: Any,
) -> ModelSpec:
    """See `probe_model.spec_of`; the press' polynomials are the first stage, which a reference joins."""
    spec = spec_of(
        "field",
        model.stroke,
        model.widths,
        model.domain,
        FORCE_N_PER_M,
        training,
        force_map,
        notes,
        hard_below=model.border,
        first=first_stage(model.press, joining),
    )
    return replace(spec, checks=checks, across=across, layers=layers).validate()


def first_stage(press: Polynomial, joining: Joining) -> FirstStage:
    """Estimates of `model.ESTIMATES` from the press's features."""
    triangle = tuple(floats(row[: j + 1]) for j, row in enumerate(joining.triangle))
    part = model_data.Joining(floats(joining.weights), triangle, float(joining.limit))
    return stage_of(press, estimates_of(press, ESTIMATES), part)
