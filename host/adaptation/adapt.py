"""`adapt`: a model of simulated strokes, corrected and recalibrated by strokes over lumps that are known."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from palpate.adaptation import correction, recalibration
from palpate.adaptation.correction import FEATURES, OFFSET, SLOPES, TERMS, Basis, Correction
from palpate.dataset.answers import OUTPUTS, found, truth_of
from palpate.dataset.columns import DataSetError
from palpate.dataset.strokes import ObservedDataSet, observe_data_set
from palpate.dataset.table import DataSet
from palpate.features.map_features import Floats
from palpate.learn.probe_model import training_hash
from palpate.model_export.integers.reference import (
    evaluate,
    half_widths,
    inputs,
    link_ends,
    monomials,
    sigma_of,
    standardised,
)
from palpate.model_export.schema import ModelSpec
from palpate.progress import ProgressCallback

FEWEST_LUMPS = 5
"""Fewer are refused: their mean error says less than the simulated model."""
FAMILIAR = 0.975
"""Share of the data set's strokes that the adapted domain takes in."""
_ROOM, _WIDER = 0.1, 1.2


@dataclass(frozen=True)
class Adapted:
    """An adapted model and how it came about.

    Attributes
    ----------
    spec : ModelSpec
    corrections : dict of Correction
        By output; those without a truth are missing.
    widths : dict of float
        By what each output's interval was multiplied.
    lumps, strokes : int
        That were used: found, and with a truth.
    """

    spec: ModelSpec
    corrections: dict[str, Correction]
    widths: dict[str, float]
    lumps: int
    strokes: int


def adapt(spec: ModelSpec, data: DataSet, progress: ProgressCallback | None = None) -> Adapted:
    """Adapt a model to a data set.

    Raises
    ------
    DataSetError
        Fewer than `FEWEST_LUMPS` lumps were found; or a recording cannot be used: row and column.
    """
    return adapt_to(spec, observe_data_set(data, spec, progress))


def adapt_to(spec: ModelSpec, seen: ObservedDataSet, fewest: int = FEWEST_LUMPS) -> Adapted:
    """The same with strokes that have been read; `fewest` lumps are asked for."""
    seen = seen.take(found(spec, seen.X, seen.status))
    lumps = len(np.unique(seen.lump))
    if lumps < fewest:
        raise DataSetError(
            f"{lumps} lumps were found in the data set; a model is adapted to {fewest} or more: fewer "
            "would as soon make it worse"
        )
    truth = link_truth(spec, seen)
    basis, said, map_back = basis_of(spec, seen)
    corrections: dict[str, Correction] = {}
    change = np.zeros((basis.phi.shape[1], len(spec.outputs)))
    held_out = np.array(said["y"])
    for j, output in enumerate(spec.outputs):
        known = ~np.isnan(truth[:, j])
        if len(np.unique(seen.lump[known])) < fewest:
            continue
        group, own = seen.lump[known], Basis(basis.phi[known], basis.level)
        residual = truth[known, j] - said["y"][known, j]
        means, errors = own.means(group), correction.mean_of(residual, group)
        corrections[output.name] = correction.fit(means, errors)
        change[:, j] = corrections[output.name].coefficients
        rows = np.flatnonzero(known)
        for lump, without in zip(np.unique(group), correction.left_out(means, errors)):
            left = rows[group == lump]
            held_out[left, j] += basis.phi[left] @ without.coefficients
    held_out = np.clip(held_out, *link_ends(spec))
    half = half_widths(spec, held_out, sigma_of(spec, standardised(spec, columns(spec, seen)), held_out))
    widths = {}
    for j, output in enumerate(spec.outputs):
        if output.name in corrections:
            known = ~np.isnan(truth[:, j])
            score = np.abs(truth[known, j] - held_out[known, j]) / half[known, j]
            widths[output.name] = recalibration.factor(score, seen.lump[known], spec.interval.level)
    return Adapted(
        _assemble(spec, seen, truth, map_back(change), widths, corrections),
        corrections,
        widths,
        lumps,
        len(seen),
    )


def link_truth(spec: ModelSpec, seen: ObservedDataSet) -> Floats:
    """Truths on the link scale, (n, outputs); NaN where they are not known."""
    truth = truth_of(seen)[:, [OUTPUTS.index(output.name) for output in spec.outputs]]
    return np.where([output.link == "ln" for output in spec.outputs], np.log(truth), truth)


def basis_of(
    spec: ModelSpec, seen: ObservedDataSet
) -> tuple[Basis, dict[str, Any], Callable[[Floats], Floats]]:
    """What a correction is made of: phi of each stroke, what the model says, and the way back.

    The last turns coefficients (columns, outputs) over phi into changes of the model's coefficients, (terms,
    outputs).
    """
    X = columns(spec, seen)
    said = evaluate(spec, X)
    C = np.array([o.coefficients for o in spec.outputs]).T
    T = monomials(standardised(spec, X), spec.terms)
    lo, hi = link_ends(spec)
    middle, size = (lo + hi) / 2, (hi - lo) / 4
    outputs = (T @ C - middle) / size
    sizes = np.array([1.0 if len(term) < 2 else 2.0 ** (len(term) - 1) for term in spec.terms])
    degree = np.array([len(term) for term in spec.terms])
    level = np.where(degree == 0, OFFSET, np.where(degree == 1, FEATURES, TERMS))
    basis = Basis(
        np.hstack([T / sizes, outputs]), np.concatenate([level, np.full(len(spec.outputs), SLOPES)])
    )
    constant = [k for k, term in enumerate(spec.terms) if not term]

    def back(B: Floats) -> Floats:
        own, slopes = B[: len(spec.terms)] / sizes[:, None], B[len(spec.terms) :] / size[:, None]
        change = own + C @ slopes
        change[constant] -= middle @ slopes
        return np.asarray(change, float)

    return basis, said, back


def columns(spec: ModelSpec, seen: ObservedDataSet) -> Floats:
    """The model's features of each stroke, (n, features)."""
    return inputs(spec, seen.X)[:, : len(spec.features)]


def _assemble(
    spec: ModelSpec,
    seen: ObservedDataSet,
    truth: Floats,
    change: Floats,
    widths: dict[str, float],
    corrections: dict[str, Correction],
) -> ModelSpec:
    """The adapted model: coefficients, quantiles and domain changed, and where it comes from."""
    outputs = tuple(
        replace(o, coefficients=tuple(map(float, np.array(o.coefficients) + change[:, j])))
        for j, o in enumerate(spec.outputs)
    )
    pairs = tuple(
        (soft * widths.get(o.name, 1.0), hard * widths.get(o.name, 1.0))
        for o, (soft, hard) in zip(spec.outputs, spec.interval.quantiles)
    )
    data = training_hash(seen.X, np.nan_to_num(truth))
    before = str(spec.training["hash"])
    adapted = {
        "from": before,
        "data": data,
        "lumps": len(np.unique(seen.lump)),
        "strokes": len(seen),
        "outputs": {name: {"correction": c.words, "widths": widths[name]} for name, c in corrections.items()},
    }
    own = hashlib.sha256(bytes.fromhex(before) + bytes.fromhex(data)).hexdigest()
    training = {k: v for k, v in spec.training.items() if k != "features"}
    return replace(
        spec,
        outputs=outputs,
        interval=replace(spec.interval, quantiles=pairs),
        domain=_domain(spec, seen),
        training=training | {"hash": own, "adapted": adapted},
        across=None,  # nobody has corrected it by real strokes
        layers=None,
    ).validate()


def _domain(spec: ModelSpec, seen: ObservedDataSet) -> Any:
    """Box and distance widened by what the data set's strokes need; never narrowed."""
    X = columns(spec, seen)
    clipped = np.clip(X, spec.clip_lo, spec.clip_hi)
    room = _ROOM * np.ptp(clipped, axis=0)
    lo = np.maximum(np.minimum(spec.domain.lo, clipped.min(axis=0) - room), spec.clip_lo)
    hi = np.minimum(np.maximum(spec.domain.hi, clipped.max(axis=0) + room), spec.clip_hi)
    distance = evaluate(spec, X)["distance"] * spec.domain.threshold
    wanted = _WIDER * float(np.quantile(distance, FAMILIAR, method="higher"))
    return replace(
        spec.domain,
        lo=tuple(map(float, lo)),
        hi=tuple(map(float, hi)),
        threshold=max(spec.domain.threshold, wanted),
    )
