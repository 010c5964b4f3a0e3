"""The checks of a model; every failure is a ModelError of one sentence."""

from __future__ import annotations

import math
from typing import Any

from palpate.model_export.errors import ModelError
from palpate.model_export.model_data import Across, FirstStage, Joining, Layers, ModelData
from palpate.model_export.vocabulary import KINDS, LINKS, OF_THE_PRESS, OUTPUTS

MOST = 1e18
"""Any number of a model; fixed point holds none as large, and squares of it are no infinities."""
MAX_FEATURES = 24
MAX_TERMS = 400
MAX_DEGREE = 3
MAX_ESTIMATES = 3
MAX_MARGIN = 4  # half-widths
JOINED = ("ln_reach", "ln_t", "ln_layers")
MAX_STEEPNESS = 500
MAX_SQUARE = 500
MOST_SPREAD = 100
MOST_STRETCH = 5
MOST_SLOPE = 10
OF_LAYERS = 3
LN_ENDS = (1e-5, 500.0)
IDENTITY_ENDS = (-500.0, 500.0)


def _short(value: Any) -> str:
    """A value in an error's sentence, however long it is."""
    if isinstance(value, int) and abs(value) >= 1 << 64:
        return f"an integer of {value.bit_length()} bits"
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:80]}..."


def _need(condition: bool, sentence: str) -> None:
    if not condition:
        raise ModelError(sentence)


def _number(value: Any, where: str) -> float:
    ok = isinstance(value, int | float) and not isinstance(value, bool)
    _need(ok and value - value == 0, f"{where} must be a finite number, not {_short(value)}")
    _need(abs(value) <= MOST, f"{where} must lie within +-{MOST:g}, not {_short(value)}")
    return float(value)


def _numbers(values: Any, n: int, where: str) -> list[float]:
    _need(isinstance(values, tuple) and len(values) == n, f"{where} must be a list of {n} numbers")
    return [_number(v, f"{where}[{i}]") for i, v in enumerate(values)]


def _terms(terms: Any, n_features: int, where: str) -> None:
    _need(
        isinstance(terms, tuple) and len(terms) <= MAX_TERMS,
        f"{where} must be a list of at most {MAX_TERMS} terms",
    )
    for k, term in enumerate(terms):
        ok = isinstance(term, tuple) and all(type(i) is int and 0 <= i < n_features for i in term)
        _need(ok, f"{where}[{k}] must be a list of indices below {n_features}, not {term!r}")
        _need(
            len(term) <= MAX_DEGREE,
            f"{where}[{k}] has degree {len(term)}, the evaluator knows up to {MAX_DEGREE}",
        )
        _need(tuple(sorted(term)) == term, f"{where}[{k}] must be sorted, not {term!r}")
    _need(len(set(terms)) == len(terms), f"{where} names a term twice")


def spec(model: ModelData) -> None:
    """Raise ModelError with the first thing that is wrong with `model`."""
    _head(model)
    if model.first is not None:
        _stage(model.first, "first")
    n = len(model.features)
    _features(model, n)
    if model.checks is not None:
        _stage(model.checks, "checks")
        _need(model.checks.joining is None, "a reference joins the first stage, not the checks")
        own = {*model.features, *OF_THE_PRESS}
        strange = [name for name in model.checks.features if name not in own]
        _need(not strange, f"the checks take {strange[:1]}, none of the model's features nor of the press's")
        ends = all(e.lo < 0 < e.hi for e in model.checks.estimates)
        _need(ends, "a check must be held within ends on both sides of 0")
    if model.across is not None:
        _across(model.across, model.features)
    if model.layers is not None:
        _layers(model.layers, n)
    _terms(model.terms, n, "terms")
    _outputs(model)
    _interval(model, n)
    _domain(model, n)
    _rules(model)


def _head(model: ModelData) -> None:
    _need(model.kind in KINDS, f"kind must be one of {', '.join(KINDS)}, not {model.kind!r}")
    ok = isinstance(model.probe, str) and model.probe.isascii() and 0 < len(model.probe) <= 16
    _need(ok, f"probe must be 1 to 16 ASCII characters, not {model.probe!r}")
    version = model.features_version
    _need(type(version) is int and 0 < version < 256, "features_version must be an integer from 1 to 255")
    _need(isinstance(model.training, dict), "training must be an object")
    digest = model.training.get("hash")
    ok = isinstance(digest, str) and len(digest) == 64 and all(c in "0123456789abcdef" for c in digest)
    _need(ok, 'training["hash"] must be 64 lower-case hex digits (SHA-256 of the training set)')
    n = model.training.get("n")
    _need(type(n) is int and n > 0, 'training["n"] must be the number of training strokes')
    _need(model.force_map is None or isinstance(model.force_map, dict), "force_map must be an object or null")
    _finite(model.training, "training")
    _finite(model.notes, "notes")
    _finite(model.force_map, "force_map")


def _finite(value: Any, where: str) -> None:
    """NaN and infinity inside free-form parts are refused too: JSON cannot express them."""
    if isinstance(value, float):
        _need(math.isfinite(value), f"{where} must be finite, not {value!r}")
    elif isinstance(value, dict):
        for key, item in value.items():
            _finite(item, f"{where}[{key!r}]")
    elif isinstance(value, list | tuple):
        for i, item in enumerate(value):
            _finite(item, f"{where}[{i}]")


def _features(model: ModelData | FirstStage, n: int) -> None:
    _need(0 < n <= MAX_FEATURES, f"a model has 1 to {MAX_FEATURES} features, not {n}")
    _need(all(isinstance(f, str) for f in model.features), "features must be names")
    _need(len(set(model.features)) == n, "features names a feature twice")
    centre = _numbers(model.centre, n, "centre")
    scale = _numbers(model.scale, n, "scale")
    lo = _numbers(model.clip_lo, n, "clip_lo")
    hi = _numbers(model.clip_hi, n, "clip_hi")
    for i, name in enumerate(model.features):
        _need(scale[i] > 0, f"scale of {name} must be positive, not {scale[i]}")
        _need(lo[i] < hi[i], f"clip_lo of {name} must be below its clip_hi")
        _need(lo[i] <= centre[i] <= hi[i], f"centre of {name} must lie between clip_lo and clip_hi")
        _need(
            max(abs(lo[i]), abs(hi[i])) < 32,
            f"{name}: the firmware's features end at +-32, the clip does not",
        )


def _stage(first: FirstStage, where: str) -> None:
    n = len(first.features)
    _features(first, n)
    _terms(first.terms, n, f"{where}.terms")
    estimates = first.estimates
    ok = isinstance(estimates, tuple) and 0 < len(estimates) <= MAX_ESTIMATES
    _need(ok, f"{where}.estimates must be a list of 1 to {MAX_ESTIMATES}")
    names = [e.name for e in estimates]
    ok = all(isinstance(name, str) and name.isidentifier() for name in names) and len(set(names)) == len(
        names
    )
    _need(ok, f"{where}.estimates must have names of their own, not {names}")
    for e in estimates:
        lo, hi = _number(e.lo, f"lo of {e.name}"), _number(e.hi, f"hi of {e.name}")
        _need(-32 < lo < hi < 32, f"{e.name}: lo must be below hi, both within +-32")
        _numbers(e.coefficients, len(first.terms), f"coefficients of {e.name}")

    if first.joining is not None:
        _joining(first.joining, tuple(names))


def _joining(joining: Joining, names: tuple[str, ...]) -> None:
    _need(names == JOINED, f"a reference joins the estimates {', '.join(JOINED)}, not {', '.join(names)}")
    estimates = len(names)
    weights = _numbers(joining.weights, estimates, "joining.weights")
    _need(all(0 <= w <= 1 for w in weights), "joining.weights must lie between 0 and 1")
    rows = joining.triangle
    _need(isinstance(rows, tuple) and len(rows) == estimates, "joining.triangle must have three rows")
    for i, row in enumerate(rows):
        entries = _numbers(row, i + 1, f"joining.triangle[{i}]")
        _need(all(abs(v) < MAX_STEEPNESS for v in entries), f"joining.triangle[{i}] must lie within +-500")
    _need(
        0 < _number(joining.limit, "joining.limit") <= MAX_SQUARE, "joining.limit must lie within 0 and 500"
    )


def _across(across: Across, features: tuple[str, ...]) -> None:
    level = _number(across.level, "across.level")
    _need(0 < level < 1, f"across.level must lie between 0 and 1, not {level}")
    width = across.width
    _need(isinstance(width, FirstStage), "across.width must be an object")
    _stage(width, "across.width")
    _need(width.joining is None, "a reference joins the first stage, not the width across")
    _need(len(width.estimates) == 1, f"across.width has one estimate, not {len(width.estimates)}")
    strange = [name for name in width.features if name not in features]
    _need(not strange, f"the width across takes {strange[:1]}, which is none of the model's features")
    spread = _numbers(across.width_spread, len(width.features) + 2, "across.width_spread")
    spread += _numbers(across.place_spread, 2, "across.place_spread")
    _need(all(abs(v) < MOST_SPREAD for v in spread), f"across: a spread must lie within +-{MOST_SPREAD}")
    stretch = _number(across.place_stretch, "across.place_stretch")
    _need(0 < stretch <= MOST_STRETCH, f"across.place_stretch must lie within 0 and {MOST_STRETCH}")


def _layers(layers: Layers, features: int) -> None:
    level, sure = _number(layers.level, "layers.level"), _number(layers.sure, "layers.sure")
    _need(0 < level < 1, f"layers.level must lie between 0 and 1, not {level}")
    _need(0.5 < sure < 1, f"layers.sure must lie between 1/2 and 1, not {sure}")
    slope = _number(layers.slope, "layers.slope")
    _need(abs(slope) <= MOST_SLOPE, f"layers.slope must lie within +-{MOST_SLOPE}")
    for name, rows in (("spread", layers.spread), ("quantiles", layers.quantiles)):
        three = isinstance(rows, tuple) and len(rows) == OF_LAYERS
        _need(three, f"layers.{name} must have a row for each of in_fat, depth and size")
    for j, (row, triple) in enumerate(zip(layers.spread, layers.quantiles)):
        spread = _numbers(row, features + 2, f"layers.spread[{j}]")
        _need(all(abs(v) < MOST_SPREAD for v in spread), f"layers: a spread must lie within +-{MOST_SPREAD}")
        of_each = _numbers(triple, OF_LAYERS, f"layers.quantiles[{j}]")
        _need(min(of_each) > 0, f"layers.quantiles[{j}] must be positive")


def _outputs(model: ModelData) -> None:
    names = tuple(getattr(o, "name", None) for o in model.outputs)
    wanted = tuple(name for name, _ in OUTPUTS)
    _need(names == wanted, f"outputs must be {', '.join(wanted)} in this order, not {names}")
    for o in model.outputs:
        _need(o.link in LINKS, f"the link of {o.name} must be one of {', '.join(LINKS)}, not {o.link!r}")
        lo, hi = _number(o.lo, f"lo of {o.name}"), _number(o.hi, f"hi of {o.name}")
        _need(lo < hi, f"lo of {o.name} must be below its hi")
        least, most = LN_ENDS if o.link == "ln" else IDENTITY_ENDS
        _need(
            least <= lo and hi <= most,
            f"{o.name}: with a link of {o.link} lo and hi must lie within {least:g} and {most:g}",
        )
        _numbers(o.coefficients, len(model.terms), f"coefficients of {o.name}")


def _interval(model: ModelData, n: int) -> None:
    interval = model.interval
    level = _number(interval.level, "interval.level")
    _need(0 < level < 1, f"interval.level must lie between 0 and 1, not {level}")
    _terms(interval.terms, n, "interval.terms")
    linear = all(len(term) <= 1 for term in interval.terms)
    _need(linear, "interval.terms must be features: ln sigma has no products of them")
    m = len(model.outputs)
    _need(len(interval.coefficients) == m, f"interval.coefficients must have a row for each of {m} outputs")
    _need(len(interval.quantiles) == m, f"interval.quantiles must have a pair for each of {m} outputs")
    for j, row in enumerate(interval.coefficients):
        _numbers(row, len(interval.terms) + m, f"interval.coefficients[{j}]")
        pair = _numbers(interval.quantiles[j], 2, f"interval.quantiles[{j}]")
        _need(min(pair) >= 0, f"interval.quantiles[{j}] must not be negative")


def _domain(model: ModelData, n: int) -> None:
    domain = model.domain
    lo, hi = _numbers(domain.lo, n, "domain.lo"), _numbers(domain.hi, n, "domain.hi")
    for i, name in enumerate(model.features):
        inside = model.clip_lo[i] <= lo[i] < hi[i] <= model.clip_hi[i]
        _need(inside, f"the domain of {name} must be a range within its clip")
    _numbers(domain.centre, n, "domain.centre")
    _need(len(domain.precision) == n, f"domain.precision must be {n} x {n}")
    rows = [_numbers(row, n, f"domain.precision[{i}]") for i, row in enumerate(domain.precision)]
    size = max(abs(v) for row in rows for v in row)
    even = all(abs(rows[i][j] - rows[j][i]) <= 1e-9 * size for i in range(n) for j in range(i))
    _need(even, "domain.precision must be symmetric")
    _need(_number(domain.threshold, "domain.threshold") > 0, "domain.threshold must be positive")
    _ranges(model)


def _ranges(model: ModelData) -> None:
    domain = model.domain
    pairs = isinstance(domain.ranges, tuple) and len(domain.ranges) == len(model.outputs)
    _need(pairs, f"domain.ranges must have a pair for each of {len(model.outputs)} outputs")
    for output, pair in zip(model.outputs, domain.ranges):
        where = f"domain.ranges of {output.name}"
        _need(isinstance(pair, tuple) and len(pair) == 2, f"{where} must be a pair of numbers or null")
        lo, hi = (end if e is None else _number(e, where) for e, end in zip(pair, (output.lo, output.hi)))
        _need(output.lo <= lo < hi <= output.hi, f"{where} must lie within the output's lo and hi")
    margin = _number(domain.margin, "domain.margin")
    _need(0 <= margin < MAX_MARGIN, f"domain.margin must lie between 0 and {MAX_MARGIN} half-widths")


def _rules(model: ModelData) -> None:
    for i, limit in enumerate(model.lump):
        _need(isinstance(limit.feature, str), f"lump[{i}].feature must be a name")
        for word, value in (("lo", limit.lo), ("hi", limit.hi)):
            if value is not None:
                size = abs(_number(value, f"lump[{i}].{word}"))
                _need(size < 32, f"lump[{i}].{word} must lie within +-32, where the firmware's features end")
    _need(_number(model.hard_below, "hard_below") > 0, "hard_below must be positive")
    lo, hi = _numbers(model.force_range, 2, "force_range")
    _need(0 <= lo < hi <= 1000, "force_range must be two increasing numbers from 0 to 1000 N/m")
