"""A compiled regression (`palpate.fixedpoint`) as a signed image for the slots of a probe, or of any board.

The evaluator (`firmware_py.evaluator`) runs polynomials up to degree 3 and tells six outputs. A probe knows
features and outputs by name; any other board hands over integers of the program's own steps, in its order. A
program of that family becomes a `ModelSpec` and goes the way of every model; any other is refused by name.
"""

from __future__ import annotations

import hashlib
import math
import os
from dataclasses import dataclass
from typing import Any

import numpy as np

from firmware_py import feature_names, features, geometry, model_check, outputs
from palpate.fixedpoint import Program
from palpate.fixedpoint.calibration import Calibration
from palpate.model_export import check
from palpate.model_export.errors import ModelError
from palpate.model_export.exporter import Report, export
from palpate.model_export.model_data import Domain, Estimate, FirstStage, Interval, Output
from palpate.model_export.schema import ModelSpec
from palpate.model_export.vocabulary import UNTOLD

HARD_BELOW = 10.0 ** (-2 / 3)
"""E_inv23 of a lump ten times as stiff as the fat."""
DEVICE_FEATURES = 1
"""What a board of one's own says to its slots as the version of its features."""
_Q24 = 1 << 24
_LARGEST = 300.0
"""Of an output's unit and a power of ten: what a board's outputs reach over the data."""
_PLACES = 12
"""Powers of ten that a small output is told more finely, at most."""
_WIDER = 0.2
"""Of the range of the predictions over the data: how far beyond it they may go before they are held."""
_MARGIN = 1.0
"""Half-widths that a prediction may lie beyond that range and still count as inside."""

_SHARED = ("features", "centre", "scale", "clip_lo", "clip_hi", "terms")
"""What models and their stages both have."""


@dataclass(frozen=True)
class Told:
    """An output of a board of one's own: an integer of 1 is `step` of its unit."""

    name: str
    unit: str
    step: float


def image(
    program: Program,
    key_dir: str | os.PathLike[str],
    like: ModelSpec | None = None,
    first: Program | None = None,
    device: str | None = None,
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
    device : str, optional
        The name of a board of one's own, 16 characters at most: it is not for a probe, and takes
        `program.features` and gives `device_outputs(program)` in their order, whatever their names.
    signing
        As `exporter.export` takes it: `rollback`, `held`, `seen_s`, `force`.

    Raises
    ------
    ModelError, ProofError, SigningError
        In one sentence.
    """
    if device is None:
        spec = spec_of(program, like, first)
        X = _sample(program)[:, [_names(program).index(name) for name in spec.features]]
        return export(spec, key_dir, features=X, **signing)
    if like is not None or first is not None:
        raise ModelError("like and first are of a probe's image; a board of one's own has neither")
    spec = device_spec(program, device)
    places = [feature_names.NAMES.index(name) for name in spec.features]
    X = program.quantised(_sample(program))[:, places] / _Q24
    told = ",".join(f"{o.step:g} {o.name} {o.unit}".strip() for o in device_outputs(program))
    info = f"{','.join(_names(program))}\ndevice {told}".encode("ascii", "replace")
    if len(info) > model_check.INFO_BYTES:
        raise ModelError(
            f"the names of features and outputs take {len(info)} bytes of an image, more than 2048"
        )
    return export(spec, key_dir, features=X, info=info, **signing)


def device_outputs(program: Program) -> list[Told]:
    """What a board of one's own is given: out[3 k] times step is output k, then come its low and high end."""
    X = _sample(program)
    said = np.abs(np.asarray(program.model.reference(X), float))
    found = []
    for o, most in zip(program.outputs, said.max(axis=0).tolist()):
        places = max(math.ceil(math.log10(max(float(most), 1e-30) / _LARGEST)), -_PLACES)
        found.append(Told(o.name, o.unit, 10.0 ** (places - 6)))
    return found


def device_spec(program: Program, device: str) -> ModelSpec:
    """The model of `image(device=...)`: features and outputs go by the probe's names in their places."""
    if len(program.features) > features.COUNT:
        raise ModelError(f"a board's image takes {features.COUNT} features, not {len(program.features)}")
    if len(program.model.names) > outputs.COUNT:
        raise ModelError(
            f"the evaluator tells {outputs.COUNT} outputs, not {len(program.model.names)}; make an image of "
            "some, and another one of the rest"
        )
    taken = sorted({program.model.space.atoms[k].feature for p in program.model.polys for t in p for k in t})
    if len(taken) > check.MAX_FEATURES:
        raise ModelError(
            f"the evaluator takes {check.MAX_FEATURES} features, not {len(taken)}; choose them (SelectKBest)"
        )
    return spec_of(program, device=device)


def spec_of(
    program: Program, like: ModelSpec | None = None, first: Program | None = None, device: str | None = None
) -> ModelSpec:
    """The model that `image` exports; ModelError names what the evaluator cannot run."""
    own = () if first is None else tuple(first.model.names)
    parts = _polynomials(program, own, device is not None)
    calibration = program.calibration
    if calibration is None:
        raise ModelError(
            "the evaluator gives no answer without an interval; compile the program with calibrate=(X, y), "
            "data that the model was not fitted to"
        )
    names = list(program.model.names) if device is None else list(outputs.NAMES[: len(program.model.names)])
    strange = [name for name in names if name not in outputs.NAMES]
    if strange:
        raise ModelError(
            f"a probe tells {', '.join(outputs.NAMES)}, not {strange[0]}; name the outputs so (output_names)"
        )
    X = _sample(program)
    at = [atom.feature for atom in parts["used"]]
    ups = [1.0] * len(names) if device is None else [1e-6 / o.step for o in device_outputs(program)]
    said = np.asarray(program.model.reference(X), float) * ups
    told_by = {name: k for k, name in enumerate(names)}
    found: list[Output] = []
    quantiles: list[tuple[float, float]] = []
    ranges: list[tuple[float | None, float | None]] = []
    for name in outputs.NAMES:
        if name in told_by:
            k = told_by[name]
            output, ends = _output(program, k, name, parts, said[:, k], ups[k])
            ranges.append(ends)
            quantile = calibration.half_widths[k] * (ups[k] if output.link == "identity" else 1.0)
        else:
            output = Output(name, "identity", -UNTOLD, UNTOLD, (0.0,) * len(parts["terms"]))
            # so that the probe finds an untold stiffness neither hard nor soft
            quantile = 1.5e-6
            ranges.append((None, None))
        found.append(output)
        quantiles.append((quantile, quantile))
    m = len(found)
    data = hashlib.sha256(np.ascontiguousarray(X, "<f8").tobytes()).hexdigest()
    hard = HARD_BELOW if like is None else like.hard_below
    return ModelSpec(
        kind="field" if like is None else like.kind,
        probe=geometry.NAME.decode() if device is None else device,
        features_version=features.FEATURES_VERSION if device is None else DEVICE_FEATURES,
        **{word: parts[word] for word in _SHARED},
        outputs=tuple(found),
        interval=Interval(calibration.level, ((),), ((0.0,) * (1 + m),) * m, tuple(quantiles)),
        domain=_domain(calibration, parts, at, tuple(ranges)),
        lump=() if like is None else like.lump,
        hard_below=hard if device is None and "E_inv23" in told_by else 1e-6,
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


def _polynomials(program: Program, more: tuple[str, ...] = (), by_place: bool = False) -> dict[str, Any]:
    """Features, their scaling and the terms, in the words of `ModelSpec`; `atoms`: each one's place in them.

    more : names of a first stage's values
    by_place : features are known by their places, in steps, not by their names in their units
    """
    model = program.model
    if model.classes:
        raise ModelError("an image holds no classifier; a verdict goes by `program.mpy()`")
    if model.forests is not None:
        raise ModelError(
            "the evaluator runs no trees; take a linear regression after PolynomialFeatures(3), or "
            "`program.mpy()` for a board of your own"
        )
    if model.kernels is not None:
        raise ModelError(
            "the evaluator runs no kernels; take Ridge after PolynomialFeatures(3), or `program.mpy()` "
            "for a board of your own"
        )
    terms = sorted({(), *(t for p in model.polys for t in p)}, key=lambda t: (len(t), t))
    used = sorted({k for t in terms for k in t})
    atoms = [model.space.atoms[k] for k in used]
    for atom in atoms:
        if atom.function is not None:
            raise ModelError(
                f"the evaluator takes its features as they are, and {atom.name} is a function of one; "
                "take PolynomialFeatures(3) in its place"
            )
        if not by_place and atom.of.name not in (*feature_names.NAMES, *more):
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
            f"the evaluator takes terms up to degree {check.MAX_DEGREE}, not {word}; take "
            f"PolynomialFeatures({check.MAX_DEGREE})"
        )
    place = {k: i for i, k in enumerate(used)}
    # an integer of the evaluator's features is 2^-24 of their unit: of a feature in steps, one step
    unit = [a.of.step * _Q24 if by_place else 1.0 for a in atoms]
    return {
        "features": tuple(feature_names.NAMES[a.feature] if by_place else a.of.name for a in atoms),
        "unit": unit,
        "centre": tuple(float(a.centre) / u for a, u in zip(atoms, unit)),
        "scale": tuple(float(a.radius) / u for a, u in zip(atoms, unit)),
        "clip_lo": tuple(a.of.lo * a.of.step / u for a, u in zip(atoms, unit)),
        "clip_hi": tuple(a.of.hi * a.of.step / u for a, u in zip(atoms, unit)),
        "terms": tuple(tuple(place[k] for k in t) for t in terms),
        "atoms": tuple(terms),
        "used": atoms,
    }


def _output(
    program: Program, k: int, name: str, parts: dict[str, Any], said: np.ndarray, up: float
) -> tuple[Output, tuple[float, float]]:
    """Output k by that name, times `up`, and the range of its predictions over the data."""
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
            f"{model.names[k]} goes from {lo / up:.3g} to {hi / up:.3g} over the data; the evaluator tells "
            f"what lies between {limits[0] / up:g} and {limits[1] / up:g}"
        )
    held = np.clip(wide, *limits)
    poly, factor = dict(model.polys[k]), 1.0 if logarithmic else up
    if logarithmic:
        poly[()] = poly.get((), 0.0) + math.log(up)
    coefficients = tuple(factor * float(poly.get(t, 0.0)) for t in parts["atoms"])
    link = "ln" if logarithmic else "identity"
    return Output(name, link, float(held[0]), float(held[1]), coefficients), (lo, hi)


def _domain(calibration: Calibration, parts: dict[str, Any], at: list[int], ranges: Any) -> Domain:
    middle, lower, edge = calibration.ellipsoid([(i, atom) for i, atom in enumerate(parts["used"])])
    precision = lower.T @ lower
    ends = np.array([calibration.ends[i] for i in at]) / np.array(parts["unit"])[:, None]
    lo, hi = np.maximum(ends[:, 0], parts["clip_lo"]), np.minimum(ends[:, 1], parts["clip_hi"])
    if (lo >= hi).any():
        name = parts["used"][int(np.argmax(lo >= hi))].of.name
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
        Estimate(name, float(lo), float(hi), tuple(float(poly.get(t, 0.0)) for t in parts["atoms"]))
        for name, poly, lo, hi in zip(model.names, model.polys, said.min(0) - more, said.max(0) + more)
    ]
    return FirstStage(**{word: parts[word] for word in _SHARED}, estimates=tuple(found))
