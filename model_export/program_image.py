"""A compiled regression (`palpate.fixedpoint`) as a signed image for a probe's slots.

The probe's evaluator runs polynomials of its own features, up to degree 3, and tells six outputs by name.
A program of that family becomes a `ModelSpec` and goes the way of every model; any other is refused by name.
"""

from __future__ import annotations

import hashlib
import os
from typing import Any

import numpy as np

from firmware_py import feature_names, features, geometry, outputs
from palpate.fixedpoint import Program
from palpate.fixedpoint.calibration import Calibration
from palpate.fixedpoint.space import Poly
from palpate.model_export import check
from palpate.model_export.errors import ModelError
from palpate.model_export.exporter import Report, export
from palpate.model_export.model_data import Domain, Estimate, FirstStage, Interval, Output
from palpate.model_export.schema import ModelSpec
from palpate.model_export.vocabulary import UNTOLD, Term

HARD_BELOW = 10.0 ** (-2 / 3)
"""E_inv23 of a lump ten times as stiff as the fat."""
_WIDER = 0.2
"""Of the range of the predictions over the data: how far beyond it they may go before they are held."""
_MARGIN = 1.0
"""Half-widths that a prediction may lie beyond that range and still count as inside."""


def image(
    program: Program,
    key_dir: str | os.PathLike[str],
    like: ModelSpec | None = None,
    first: Program | None = None,
    **signing: Any,
) -> tuple[bytes, Report]:
    """The signed image of a program, and what there is to say of it.

    Parameters
    ----------
    program : Program
        Of a linear model over the probe's features by name (and what `first` gives), its outputs named as the
        probe names them (`firmware_py.outputs`), with `calibrate` given.
    key_dir : path
        Directory made by `palpate keygen`.
    like : ModelSpec, optional
        A model whose force map, lump rule, force range and border of hardness it has: that with which the
        features were computed. By default every stroke shows a lump, at any force.
    first : Program, optional
        A first stage: its outputs, three at most, are features of `program`.
    signing
        As `exporter.export` takes it: `rollback`, `held`, `seen_s`, `force`.

    Raises
    ------
    ModelError, ProofError, SigningError
        In one sentence.
    """
    spec = spec_of(program, like, first)
    X = _sample(program)[:, [_names(program).index(name) for name in spec.features]]
    return export(spec, key_dir, features=X, **signing)


def spec_of(program: Program, like: ModelSpec | None = None, first: Program | None = None) -> ModelSpec:
    """The model that `image` exports; ModelError names what the probe's evaluator cannot run."""
    own = () if first is None else tuple(first.model.names)
    parts = _polynomials(program, own)
    calibration = program.calibration
    if calibration is None:
        raise ModelError(
            "a probe gives no answer without an interval; compile the program with calibrate=(X, y), data "
            "that the model was not fitted to"
        )
    told = [o.name for o in program.outputs if o.name in program.model.names]
    strange = [name for name in told if name not in outputs.NAMES]
    if strange:
        raise ModelError(
            f"a probe tells {', '.join(outputs.NAMES)}, not {strange[0]}; name the outputs so (output_names)"
        )
    X = _sample(program)
    at = [_names(program).index(name) for name in parts["features"]]
    said = np.asarray(program.model.reference(X), float)
    told_by = {name: k for k, name in enumerate(program.model.names)}
    found: list[Output] = []
    quantiles: list[tuple[float, float]] = []
    ranges: list[tuple[float | None, float | None]] = []
    for name in outputs.NAMES:
        if name in told_by:
            k = told_by[name]
            output, ends = _output(program, k, parts["terms"], parts["atoms"], said[:, k])
            ranges.append(ends)
            quantile = calibration.half_widths[k]
        else:
            output = Output(name, "identity", -UNTOLD, UNTOLD, (0.0,) * len(parts["terms"]))
            # so that the probe finds an untold stiffness neither hard nor soft
            quantile = 1.5e-6
            ranges.append((None, None))
        found.append(output)
        quantiles.append((quantile, quantile))
    n, m = len(at), len(found)
    data = hashlib.sha256(np.ascontiguousarray(X, "<f8").tobytes()).hexdigest()
    hard = HARD_BELOW if like is None else like.hard_below
    return ModelSpec(
        kind="field" if like is None else like.kind,
        probe=geometry.NAME.decode(),
        features_version=features.FEATURES_VERSION,
        **{word: parts[word] for word in ("features", "centre", "scale", "clip_lo", "clip_hi", "terms")},
        outputs=tuple(found),
        interval=Interval(calibration.level, ((),), ((0.0,) * (1 + m),) * m, tuple(quantiles)),
        domain=_domain(calibration, parts, at, tuple(ranges), n),
        lump=() if like is None else like.lump,
        hard_below=hard if "E_inv23" in told_by else 1e-6,
        force_range=(0.0, 1000.0) if like is None or "F_N_per_m" not in told_by else like.force_range,
        training={"hash": data, "n": len(X)},
        force_map=None if like is None else like.force_map,
        first=None if first is None else _stage(first),
    ).validate()


def _names(program: Program) -> list[str]:
    return [f.name for f in program.features]


def _sample(program: Program) -> np.ndarray:
    """The data that the program is for."""
    if program.sample is not None:
        return program.sample
    assert program.calibration is not None
    return program.calibration.X


def _polynomials(program: Program, more: tuple[str, ...] = ()) -> dict[str, Any]:
    """Features, their scaling and the terms, in the words of `ModelSpec`; `atoms`: each one's place in them.

    more : names of a first stage's values
    """
    model = program.model
    if model.classes:
        raise ModelError("a probe's image holds no classifier; a verdict goes by `program.mpy()`")
    if model.forests is not None:
        raise ModelError(
            "a probe's evaluator runs no trees; take a linear regression after PolynomialFeatures(3), or "
            "`program.mpy()` for a board of your own"
        )
    if model.kernels is not None:
        raise ModelError(
            "a probe's evaluator runs no kernels; take Ridge after PolynomialFeatures(3), or `program.mpy()` "
            "for a board of your own"
        )
    terms = sorted({t for p in model.polys for t in p}, key=lambda t: (len(t), t))
    used = sorted({k for t in terms for k in t})
    atoms = [model.space.atoms[k] for k in used]
    for atom in atoms:
        if atom.function is not None:
            raise ModelError(
                f"a probe's evaluator takes its features as they are, and {atom.name} is a function of one; "
                "take PolynomialFeatures(3) in its place"
            )
        if atom.of.name not in (*feature_names.NAMES, *more):
            raise ModelError(
                f"a probe computes no feature called {atom.of.name!r}; it knows "
                f"{', '.join((*feature_names.NAMES, *more))}"
            )
    if not atoms:
        raise ModelError("the model takes none of its features; an image of a constant is refused")
    longest = terms[-1]
    if len(longest) > check.MAX_DEGREE:
        word = " * ".join(model.space.atoms[k].of.name for k in longest)
        raise ModelError(
            f"a probe's evaluator takes terms up to degree {check.MAX_DEGREE}, not {word}; take "
            f"PolynomialFeatures({check.MAX_DEGREE})"
        )
    place = {k: i for i, k in enumerate(used)}
    return {
        "features": tuple(a.of.name for a in atoms),
        "centre": tuple(float(a.centre) for a in atoms),
        "scale": tuple(float(a.radius) for a in atoms),
        "clip_lo": tuple(a.of.lo * a.of.step for a in atoms),
        "clip_hi": tuple(a.of.hi * a.of.step for a in atoms),
        "terms": tuple(tuple(place[k] for k in t) for t in terms),
        "atoms": tuple(terms),
        "used": atoms,
    }


def _coefficients(poly: Poly, terms: tuple[Term, ...]) -> tuple[float, ...]:
    return tuple(float(poly.get(t, 0.0)) for t in terms)


def _output(
    program: Program, k: int, terms: tuple[Term, ...], atoms: tuple[Term, ...], said: np.ndarray
) -> tuple[Output, tuple[float, float]]:
    """Output k, and the range of its predictions over the data."""
    model = program.model
    logarithmic = model.links[k] == "exp"
    lo, hi = float(said.min()), float(said.max())
    ends = np.log([lo, hi]) if logarithmic else np.array([lo, hi])
    more = max(_WIDER * (ends[1] - ends[0]), 1e-3)
    wide = np.array([ends[0] - more, ends[1] + more])
    if logarithmic:
        wide = np.exp(wide)
    limits = check.LN_ENDS if logarithmic else check.IDENTITY_ENDS
    if lo < limits[0] or hi > limits[1]:
        raise ModelError(
            f"{model.names[k]} goes from {lo:.3g} to {hi:.3g} over the data; a probe tells what lies between "
            f"{limits[0]:g} and {limits[1]:g}"
        )
    held = np.clip(wide, *limits)
    assert len(terms) == len(atoms)
    link = "ln" if logarithmic else "identity"
    return Output(
        model.names[k], link, float(held[0]), float(held[1]), _coefficients(model.polys[k], atoms)
    ), (lo, hi)


def _domain(calibration: Calibration, parts: dict[str, Any], at: list[int], ranges: Any, n: int) -> Domain:
    middle, lower, edge = calibration.ellipsoid([(i, atom) for i, atom in enumerate(parts["used"])])
    precision = lower.T @ lower
    ends = np.array([calibration.ends[i] for i in at])
    lo, hi = np.maximum(ends[:, 0], parts["clip_lo"]), np.minimum(ends[:, 1], parts["clip_hi"])
    if (lo >= hi).any():
        name = parts["features"][int(np.argmax(lo >= hi))]
        raise ModelError(f"{name} does not vary over the data of calibrate")
    return Domain(
        tuple(lo.tolist()),
        tuple(hi.tolist()),
        tuple(middle.tolist()),
        tuple(map(tuple, ((precision + precision.T) / 2).tolist())),
        float(edge),
        ranges,
        _MARGIN,
    )


def _stage(first: Program) -> FirstStage:
    """A program's outputs as estimates of a first stage, which holds values as they are."""
    parts = _polynomials(first)
    model, X = first.model, _sample(first)
    if any(link == "exp" for link in model.links):
        raise ModelError("a first stage's values are held as they are: fit it to the logarithm itself")
    said = np.asarray(model.reference(X), float)
    more = _WIDER * np.ptp(said, axis=0) + 1e-3
    found = [
        Estimate(name, float(lo), float(hi), _coefficients(poly, parts["atoms"]))
        for name, poly, lo, hi in zip(model.names, model.polys, said.min(0) - more, said.max(0) + more)
    ]
    words = ("features", "centre", "scale", "clip_lo", "clip_hi", "terms")
    return FirstStage(**{word: parts[word] for word in words}, estimates=tuple(found))
